# Every target does its own set-up, in .venv and target/, and only what is not there yet.
PYTHON ?= python3
VENV := .venv
BIN := $(CURDIR)/$(VENV)/bin
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo -n)
RUST := Cargo.toml pyproject.toml $(wildcard Cargo.lock) $(shell find src shaders -type f 2>/dev/null)

# In all that cargo is called for, lest pyo3 be compiled anew each time.
WITH_PYTHON := PYO3_PYTHON=$(BIN)/python
export PATH := $(PATH):$(HOME)/.cargo/bin

# The comparisons with analytic truth and an independent code.
TRUTHS := $(patsubst %,tests/test_%.py,slab infinite furnace cube60 single trackers lanes angular \
  environment emission energy absorbed unscattered tally order1 outline thick calibration voxel_bias \
  path path_lights path_sky path_solids mitsuba mitsuba_pairs mitsuba_wrong mitsuba_stored interop \
  api bad_input)

.PHONY: help demo test test-rust test-python lint-python wheel bench validate mutants fmt clean check-rust check-lint llvm vulkan
.DELETE_ON_ERROR:

help:
	@echo "make demo      build, simulate light in a real MRI volume, write demo/*.png"
	@echo "make test      every test and check, Rust and Python"
	@echo "make wheel     build dist/*.whl (on Linux for manylinux_2_17), install it afresh and run it"
	@echo "make bench     how fast it is, as ratios measured in one run (BENCH='cube60 cloud --large': these groups, 512^3 too)"
	@echo "make validate  the comparisons with analytic truth and with Mitsuba, one line each, hours the first time"
	@echo "make mutants   small mutations of the code, each with the tests that must notice it (MUTANTS='merge: shader:')"
	@echo "make fmt       format the Rust and Python sources"
	@echo "make clean     remove what was built (.venv, target, demo)"
	@echo "PYTHON=...     another Python (>= 3.11) than python3"

demo: $(VENV)/.package $(VENV)/.demo
	$(BIN)/python -m mcrt demo --output demo

# Side by side: while one compiles with one core, the other installs or lints.
test:
	$(MAKE) -j2 test-rust test-python

test-rust: check-rust check-lint $(BIN)/python vulkan
	cargo fmt --check
	$(WITH_PYTHON) cargo clippy --release --all-targets --features python -- -D warnings
	$(WITH_PYTHON) cargo test --release

# Many tests use one core: two processes take files in turn.
test-python: lint-python $(VENV)/.package $(VENV)/.demo llvm vulkan
	$(BIN)/python -m mypy.stubtest mcrt._mcrt
	$(BIN)/python -m pytest -n 2 --dist loadfile --nbmake tests notebooks/first_steps.ipynb

lint-python: $(VENV)/.test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/python -m mypy python/mcrt

# Zig links against an old glibc, whatever the machine's is.
wheel: $(VENV)/.maturin $(VENV)/.wheel | check-rust
	rm -rf dist
	PATH="$(BIN):$(PATH)" $(WITH_PYTHON) $(BIN)/maturin build --release --out dist \
	  $(if $(filter Linux,$(shell uname)),--zig --compatibility manylinux_2_17)
	$(BIN)/python tests/wheel.py

bench: $(VENV)/.package $(VENV)/.test $(VENV)/.demo llvm vulkan
	$(BIN)/python tests/bench/bench.py $(BENCH)

validate: $(VENV)/.package $(VENV)/.test $(VENV)/.demo llvm vulkan
	MCRT_ALL_ON_GPU=1 $(BIN)/python -m pytest -v $(TRUTHS)
	$(BIN)/python tests/validate.py
	$(BIN)/python tests/random_scenes.py 1000

mutants: $(VENV)/.package $(VENV)/.test vulkan
	$(BIN)/python tests/mutants.py $(MUTANTS)

fmt: check-lint $(VENV)/.test
	cargo fmt
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	rm -rf target $(VENV) demo python/mcrt/_mcrt*.so

# Set-up

check-rust:
	@command -v cargo >/dev/null || { echo "Missing: cargo. Install Rust from https://rustup.rs"; exit 1; }
	@command -v cc >/dev/null || { echo "Missing: a C linker (cc). Debian: apt-get install gcc libc6-dev"; exit 1; }

check-lint: check-rust
	@cargo fmt --version >/dev/null 2>&1 && cargo clippy --version >/dev/null 2>&1 || \
	  { echo "Missing: rustfmt or clippy. rustup component add rustfmt clippy"; exit 1; }

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Missing: Python >= 3.11. make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "Missing: Python's venv. Debian: apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# What pyproject.toml names: $(call requirements,PATH TO THE LIST)
requirements = $(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb")); \
  print(*p$(1), sep="\n")'

$(VENV)/.maturin: $(BIN)/python
	$(call requirements,["build-system"]["requires"]) > $@.txt
	$(BIN)/python -m pip install -q --no-compile --disable-pip-version-check -r $@.txt
	touch $@

$(VENV)/.package: $(VENV)/.maturin $(RUST) | check-rust
	$(WITH_PYTHON) $(BIN)/maturin develop --release
	touch $@

$(VENV)/.test: pyproject.toml $(BIN)/python
	$(call requirements,["project"]["optional-dependencies"]["test"]) > $@.txt
	$(BIN)/python -m pip install -q --no-compile --disable-pip-version-check -r $@.txt
	touch $@

$(VENV)/.wheel: pyproject.toml $(BIN)/python
	$(call requirements,["project"]["optional-dependencies"]["wheel"]) > $@.txt
	$(BIN)/python -m pip install -q --no-compile --disable-pip-version-check -r $@.txt
	touch $@

# Only a data file of nilearn is read: its dependencies are not needed.
$(VENV)/.demo: pyproject.toml $(BIN)/python
	$(call requirements,["project"]["optional-dependencies"]["demo"]) > $@.txt
	$(BIN)/python -m pip install -q --no-compile --disable-pip-version-check --no-deps -r $@.txt
	touch $@

# Mitsuba's fast variants need LLVM (not 15 or 16).
llvm:
	@ls /usr/lib/*/libLLVM*19* /usr/lib/llvm-19/lib/libLLVM*.so* >/dev/null 2>&1 \
	  || { command -v apt-get >/dev/null && $(SUDO) apt-get update -qq \
	       && $(SUDO) apt-get install -qq -y --no-install-recommends libllvm19; } \
	  || echo "Missing: libllvm19. The comparison with Mitsuba runs its slower scalar variant."

# The tests of the GPU backend run on any adapter; Mesa has one that the processor plays.
vulkan:
	@ls /usr/share/vulkan/icd.d/lvp_icd.*.json >/dev/null 2>&1 \
	  || { command -v apt-get >/dev/null && $(SUDO) apt-get update -qq \
	       && $(SUDO) apt-get install -qq -y --no-install-recommends mesa-vulkan-drivers; } \
	  || echo "Missing: mesa-vulkan-drivers. Without a GPU the tests of the GPU backend are skipped."
