# Swathe's house rules as commands. `make help` lists them; CONTRIBUTING.md tells how long each takes.
#
# Everything a target installs comes by package name from apt, PyPI or crates.io, in the versions and with the hashes
# that requirements/ and Cargo.lock name. Nothing is written outside this folder, except by `make system-packages`.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules

VENV := .venv
BIN := $(VENV)/bin
# The first Python of 3.11 or later; `make PYTHON=/path/to/python3 ...` chooses another.
PYTHON ?= $(shell for name in python3 python3.14 python3.13 python3.12 python3.11; do \
	"$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$name"; break; }; done)

# cargo, maturin and uv must all see this environment and no other that happens to be active.
export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python
unexport CONDA_PREFIX PYTHONPATH PYTHONHOME
# Property tests draw the same examples on every run; `make test-rust PROPTEST_RNG_SEED=$RANDOM` draws others.
export PROPTEST_RNG_SEED ?= 1

RUST_SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find crates -name '*.rs' -o -name Cargo.toml)
PYTHON_CODE := $(wildcard python/swathe tests benchmarks examples)
UV_LOCK := $(BIN)/uv pip compile --quiet --generate-hashes --universal --python-version 3.11 --no-header --no-annotate
# `make lock UPGRADE=--upgrade` takes the newest versions instead of keeping those that still fit.
UPGRADE ?=
ifneq ($(wildcard crates/swathe-py/tests),)
CARGO_TEST_PACKAGES := --workspace
else
# A crate that only converts has nothing of its own to test in Rust; its tests are in Python.
CARGO_TEST_PACKAGES := --workspace --exclude swathe-py
endif

define announce
@printf '\n==> %s\n' "$(1)"
endef

.PHONY: help demo test build bench trials fmt lock clean
.PHONY: lint lint-rust lint-python lint-types lint-imports test-rust test-python system-packages bench-packages

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "make %-16s %s\n", $$1, $$2}'

demo: build ## build, then plan and drive a route on the bundled terrain
	$(call announce,swathe demo)
	@$(BIN)/swathe demo

test: lint test-rust test-python ## everything: lint, Rust tests, Python tests
	@printf '\n==> all tests passed\n'

build: $(VENV)/.built ## the environment in .venv with the compiled package

lint: lint-rust lint-python lint-types lint-imports ## every check that runs no test

lint-rust: $(BIN)/python
	$(call announce,cargo fmt --check)
	@cargo fmt --all --check
	$(call announce,cargo clippy)
	@cargo clippy --locked --workspace --all-targets -- --deny warnings

lint-python: $(VENV)/.synced
	$(call announce,ruff)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

lint-types: build
	$(call announce,mypy --strict)
	@$(BIN)/mypy $(PYTHON_CODE)
	$(call announce,stubtest swathe._core)
	@$(BIN)/stubtest --mypy-config-file pyproject.toml swathe._core

lint-imports: build
	$(call announce,lint-imports)
	@$(BIN)/lint-imports --no-cache --no-logo

test-rust: $(BIN)/python system-packages ## the Rust tests
	$(call announce,cargo test)
	@cargo test --locked $(CARGO_TEST_PACKAGES) -- --quiet

test-python: build system-packages ## the Python tests
	$(call announce,pytest)
	@$(BIN)/python -m pytest -n 2

bench: build bench-packages $(VENV)/.peers ## measure against named peers, then run the trials (make bench ONLY="rank route-1000": these alone)
	$(call announce,benchmarks)
	@$(BIN)/python benchmarks/run.py $(ONLY)
	@$(if $(ONLY),,$(MAKE) --no-print-directory trials)

trials: build ## drive the drawn worlds, write benchmarks/TRIALS.md; over two hours (make trials TRIALS="--only drawn --worlds 100")
	$(call announce,trials)
	@$(BIN)/python benchmarks/trials.py $(TRIALS)

fmt: $(VENV)/.synced ## format Rust and Python in place
	@cargo fmt --all
	@$(BIN)/ruff check --fix --quiet . || true
	@$(BIN)/ruff format .

# Programs that tests compare with. Without root the line to run is printed, and the tests that need it are skipped.
system-packages: ## install what some tests compare with (apt; only when missing)
	@packages=(); \
	command -v gdaldem >/dev/null || packages+=(gdal-bin); \
	command -v chromium >/dev/null || command -v chromium-browser >/dev/null || packages+=(chromium); \
	command -v grass >/dev/null || packages+=(grass-core); \
	command -v valgrind >/dev/null || packages+=(valgrind); \
	compgen -G '/usr/share/postgresql/*/extension/postgis_raster.control' >/dev/null \
		|| packages+=(postgresql-15-postgis-3 postgresql-15-postgis-3-scripts); \
	if [ $${#packages[@]} -eq 0 ]; then exit 0; fi; \
	printf '\n==> system packages: %s\n' "$${packages[*]}"; \
	if [ "$$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then \
		apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$${packages[@]}" \
			|| printf 'apt-get failed; tests that need %s are skipped.\n' "$${packages[*]}"; \
	else \
		printf 'Tests that need them are skipped. To install them: sudo apt-get install --no-install-recommends %s\n' "$${packages[*]}"; \
	fi

# Programs that only benchmarks compare with.
bench-packages:
	@packages=(); \
	command -v grass >/dev/null || packages+=(grass-core); \
	command -v raster2pgsql >/dev/null || packages+=(postgis); \
	compgen -G '/usr/share/postgresql/*/extension/postgis_raster.control' >/dev/null \
		|| packages+=(postgresql-15-postgis-3 postgresql-15-postgis-3-scripts); \
	if [ $${#packages[@]} -eq 0 ]; then exit 0; fi; \
	if [ "$$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then \
		apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$${packages[@]}"; \
	else \
		printf 'Benchmarks against them fail without. To install them: sudo apt-get install --no-install-recommends %s\n' "$${packages[*]}"; \
	fi

lock: $(BIN)/uv ## write requirements/ anew from pyproject.toml (UPGRADE=--upgrade for the newest versions)
	$(call announce,requirements/)
	@$(UV_LOCK) $(UPGRADE) pyproject.toml --group dev --output-file requirements/dev.txt
	@$(UV_LOCK) pyproject.toml --constraints requirements/dev.txt --output-file requirements/runtime.txt
	@$(UV_LOCK) $(UPGRADE) --group bench --constraints requirements/dev.txt --output-file requirements/bench.txt
	@echo uv | $(UV_LOCK) - --constraints requirements/dev.txt --output-file requirements/uv.txt

clean: ## remove everything that can be made again
	rm -rf target $(VENV) dist node_modules .hypothesis .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	rm -f python/swathe/_core*.so python/swathe/_core.pyi
	find python tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# The steps below make the environment; each is repeated only when what it is made of has changed.

$(BIN)/python:
	@if [ -z "$(PYTHON)" ]; then echo "Swathe needs Python 3.11 or later and found none. Install it (Debian, Ubuntu: sudo apt-get install python3 python3-venv), or name one: make PYTHON=/path/to/python3" >&2; exit 1; fi
	@command -v cargo >/dev/null || { echo "Swathe needs Rust 1.88 or later and found no cargo. Install Rust with rustup, then run make again." >&2; exit 1; }
	$(call announce,$(PYTHON) -m venv $(VENV))
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "This Python cannot make environments. Install the missing part (Debian, Ubuntu: sudo apt-get install python3-venv), then run make again." >&2; exit 1; }

$(BIN)/uv: | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/uv.txt

$(VENV)/.synced: requirements/dev.txt $(BIN)/uv
	$(call announce,uv pip sync requirements/dev.txt)
	@$(BIN)/uv pip sync --quiet --require-hashes --compile-bytecode requirements/dev.txt
	@touch $@

$(VENV)/.peers: requirements/bench.txt $(VENV)/.synced
	$(call announce,uv pip install requirements/bench.txt)
	@$(BIN)/uv pip install --quiet --require-hashes --compile-bytecode -r requirements/bench.txt
	@touch $@

$(VENV)/.built: $(VENV)/.synced $(RUST_SOURCES)
	$(call announce,maturin develop)
	@$(BIN)/maturin develop --locked --release --uv --quiet --generate-stubs
	@touch $@
