#!/bin/sh
# Make .venv hold exactly what requirements.lock says, and find out how this machine draws pictures.
#
# Safe to interrupt and to repeat. The stamp .venv/.complete is written last: without it an environment is
# half-made and is made again; with an old one it is brought up to date; with the current one nothing is done.
set -eu
cd "$(dirname "$0")/.."

venv=.venv
stamp=$venv/.complete
rendering=$venv/share/aerial_il/rendering

say() { printf '%s\n' "$*" >&2; }
fail() { say "setup: $*"; exit 1; }
is_root() { [ "$(id -u)" = 0 ]; }

# What the environment was made from: the folder it stands in, the files that describe it, the chosen interpreter.
fingerprint() {
    pwd
    cat requirements.lock pyproject.toml setup/environment.sh | cksum
    printf '%s\n' "${PYTHON:-}"
}

# A name on the PATH proves nothing (pyenv's shims refuse to run): every candidate is run.
interpreter_at() {
    "$1" -c 'import sys, ssl, ctypes
if not (3, 12) <= sys.version_info[:2] < (3, 14): sys.exit(1)
print(sys.executable)' 2>/dev/null
}

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        interpreter_at "$PYTHON" || fail "PYTHON=$PYTHON is not a Python 3.12 or 3.13 that runs."
        return
    fi
    for candidate in python3.12 python3.13 python3 \
        "$HOME"/.pyenv/versions/3.1[23].*/bin/python \
        "$HOME"/.local/share/uv/python/cpython-3.1[23]*/bin/python3 \
        "${HOMEBREW_PREFIX:-/opt/homebrew}"/bin/python3.1[23] \
        "${CONDA_PREFIX:-$HOME/miniforge3}"/bin/python "$HOME"/miniconda3/bin/python "$HOME"/anaconda3/bin/python; do
        interpreter_at "$candidate" && return
    done
    say "No Python 3.12 or 3.13 runs here; uv fetches one."
    "$uv" python install 3.12 >&2 && "$uv" python find --no-project 3.12 ||
        fail "no Python 3.12 or 3.13. Install one (pyenv install 3.12, conda create -n py312 python=3.12) and run: PYTHON=/path/to/python make setup"
}

# uv resolves nothing here: it fetches the locked wheels, checks their hashes and links them into place.
find_uv() {
    for candidate in uv .tools/bin/uv; do
        if "$candidate" --version >/dev/null 2>&1; then printf '%s\n' "$candidate"; return; fi
    done
    say "Fetching uv into .tools ..."
    make_tools >&2 || fail "uv is missing and could not be fetched. $(tools_advice)"
    printf '.tools/bin/uv\n'
}

make_tools() {
    for candidate in python3.12 python3.13 python3 "$HOME"/.pyenv/versions/3.1[23].*/bin/python; do
        "$candidate" -c 'import ssl' 2>/dev/null || continue
        rm -rf .tools
        "$candidate" -m venv .tools >/dev/null 2>&1 && .tools/bin/python -m pip install --quiet uv && return
        # Debian without python3-venv, but with pip: a plain folder serves as well.
        rm -rf .tools
        "$candidate" -m pip install --quiet --target .tools uv 2>/dev/null && .tools/bin/uv --version && return
    done
    is_root && command -v apt-get >/dev/null && install_debian python3 python3-venv &&
        rm -rf .tools && python3 -m venv .tools && .tools/bin/python -m pip install --quiet uv
}

tools_advice() {
    if command -v apt-get >/dev/null && ! python3 -m ensurepip --version >/dev/null 2>&1; then
        printf 'Run: sudo apt-get install -y python3 python3-venv, then this again.'
    else
        printf 'Install uv (pip install uv) or check the network, then run this again.'
    fi
}

install_debian() {
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

make_environment() {
    uv=$(find_uv)
    if [ ! -f $stamp ] || [ "$(head -n 1 $stamp)" != "$(pwd)" ] || ! $venv/bin/python -c '' 2>/dev/null; then
        python=$(find_python)
        say "Making $venv with $python ..."
        rm -rf $venv
        "$uv" venv --quiet --no-project --python "$python" $venv
    fi
    rm -f $stamp
    say "Installing what requirements.lock names (the first time about 2.6 GB) ..."
    quiet=; [ -t 2 ] || quiet=--quiet
    "$uv" pip sync $quiet --python $venv/bin/python --require-hashes --compile-bytecode requirements.lock ||
        fail "the packages are not complete. What was fetched is kept: run 'make setup' again."
    "$uv" pip install --quiet --python $venv/bin/python --no-deps --no-build-isolation --editable . ||
        fail "the project itself could not be installed into $venv."
    fingerprint > $stamp.new
    mv $stamp.new $stamp
}

probe() { $venv/bin/python -c 'import sys; from aerial_il.core import rendering; sys.exit(rendering.report_probe())'; }

prepare_rendering() {
    packages="libegl1 libopengl0 libgl1-mesa-dri"
    if [ ! -s $rendering ] && ! probe >/dev/null 2>&1; then
        if is_root && command -v apt-get >/dev/null; then
            say "Installing $packages to draw without a screen ..."
            # shellcheck disable=SC2086
            install_debian $packages || say "That did not work."
        fi
    fi
    probe >&2 || say "Pictures are off and all else works. For videos and cameras run: sudo apt-get install -y $packages"
}

if [ ! -f $stamp ] || [ "$(fingerprint)" != "$(cat $stamp)" ] || ! $venv/bin/python -c ''; then
    make_environment
    rm -f $rendering
fi
if [ "$(cat $rendering 2>/dev/null || echo disabled)" = disabled ]; then
    prepare_rendering
fi

# What flies is compiled once, not in somebody's first flight; the compiled code lies beside its sources. What only reads
# the code, such as make check, needs none of it.
kernels=$venv/share/aerial_il/kernels
sources() { find aerial_il/core aerial_il/control aerial_il/suite aerial_il/experts -name '*.py' | LC_ALL=C sort | xargs cat | cksum; }
if [ "${1:-}" != uncompiled ] && [ "$(cat $kernels 2>/dev/null)" != "$(sources)" ]; then
    say "Compiling what flies (about a minute) ..."
    if $venv/bin/python setup/compile_kernels.py; then
        sources > $kernels
    else
        say "That did not work; the first flight will do it."
    fi
fi
