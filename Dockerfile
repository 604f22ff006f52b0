# A bare Debian in which `make demo` runs: docker build -t aerial_il . && docker run --rm -v "$PWD/runs:/aerial_il/runs" aerial_il
FROM debian:trixie-slim
RUN apt-get update \
 && apt-get install -y --no-install-recommends ca-certificates git make python3 python3-venv libegl1 libopengl0 libgl1-mesa-dri \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /aerial_il
COPY . .
RUN make setup
CMD ["make", "demo"]
