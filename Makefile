# The two commands to know: make demo, make test. `make help` lists the rest.
SHELL := /bin/sh
.DEFAULT_GOAL := help
BIN := .venv/bin
ABREAST := --numprocesses=auto --maxprocesses=4 --dist=loadfile
export HF_HUB_OFFLINE := 1
export HF_DATASETS_OFFLINE := 1

.PHONY: help setup tools setup-links demo test test-links test-all fuzz check format bench bench-quick docs notebooks lock slurm newcomer clean

help: ## list these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: ## make .venv from requirements.lock and find out how to render (does nothing when up to date)
	@setup/environment.sh

setup-links: setup ## make .venv-links, which has what exports, ROS 2 and MAVLink need too
	@setup/links.sh

demo: setup ## fly, record, learn, evaluate: the whole path, resumable, with a report at the end
	@$(BIN)/aerial-il demo

test: setup ## run the tests that finish in minutes
	@OMP_NUM_THREADS=1 $(BIN)/python -m pytest $(ABREAST)

test-all: setup ## run every test, the slow ones and those that need a browser too
	@OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "" $(ABREAST)

test-links: setup-links ## fly robots over ROS 2 and MAVLink and exported policies, missions too (a quarter of an hour)
	@OMP_NUM_THREADS=1 MAVLINK20=1 .venv-links/bin/python -m pytest -m "" tests/links tests/policies/test_export.py

fuzz: setup ## read 16,000 mutated files, into runs/fuzz; interrupted, the same command continues
	@OMP_NUM_THREADS=1 $(BIN)/python -m tests.safety.fuzz runs/fuzz

tools:
	@setup/environment.sh uncompiled

check: tools ## lint, formatting, types and the layers between packages
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/basedpyright
	@$(BIN)/lint-imports

format: tools ## put the code in order
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

bench: setup ## run every study (aerial-il bench NAME runs one)
	@$(BIN)/aerial-il bench

bench-quick: setup ## fly a small version of every headline claim, half an hour on two cores, and say which hold
	@$(BIN)/aerial-il bench quick=true

docs: setup ## build the documentation into build/site (aerial-il docs open=true shows it)
	@$(BIN)/aerial-il docs out=null

notebooks: setup ## execute the notebooks that changed (only=05 chooses, again=1 executes all); interrupted, it goes on
	@$(BIN)/python setup/notebooks.py $(only) $(if $(again),--again)

lock: setup ## resolve pyproject.toml anew into requirements.lock, keeping the versions that still fit
	@PATH="$$PATH:.tools/bin" uv pip compile pyproject.toml --extra dev --universal --python-version 3.12 \
	  --generate-hashes --no-emit-index-url --no-header --no-annotate --quiet --output-file requirements.lock

slurm: ## start a SLURM of one node on this machine, installing it if need be (as root): to try launcher=slurm
	@setup/slurm.sh

newcomer: ## walk a newcomer's path on a bare Debian, as root: suite=trixie or bookworm, steps="setup demo" (an hour, 8 GB)
	@setup/newcomer.sh $(or $(suite),trixie) $(steps)

clean: ## remove caches and the environment; recordings and runs stay
	rm -rf .venv .venv-links .tools .cache .pytest_cache .ruff_cache .import_linter_cache dist build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
