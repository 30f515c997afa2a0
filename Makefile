.DEFAULT_GOAL := help
.PHONY: help setup system phantom train app benchmark speed test test-all test-oldest test-slurm lint format docs clean

PYTHON ?= python3
BIN := .venv/bin
CORE := .venv/.core
DEMO := .venv/.demo
READY := .venv/.ready
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
OLDEST := torch==2.11.0 torchvision==0.26.0
ARGS ?=
PRESET ?= laptop
DATA ?= phantom
ROOT ?=

help:  ## List the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'

$(CORE): pyproject.toml constraints.txt locks/train.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else f"col3d needs Python 3.11 or newer, but $(PYTHON) is {v[0]}.{v[1]}; say make PYTHON=python3.12")'
	$(PYTHON) -m venv .venv
ifdef TORCH_INDEX
	PIP_EXTRA_INDEX_URL= $(PIP) install --no-deps --index-url $(TORCH_INDEX) $$(grep -E '^torch(vision)?==' constraints.txt)
endif
ifdef LOCKED
	$(PIP) install --require-hashes --no-deps -r locks/build.txt
	$(PIP) install --require-hashes --no-deps --no-build-isolation -r locks/train.txt
	$(PIP) install --no-deps --no-build-isolation -e .
else
	$(PIP) install -c constraints.txt -e .
endif
	@touch $@

$(DEMO): $(CORE)
	$(PIP) install -c constraints.txt -e '.[demo]'
	@touch $@

$(READY): $(CORE) locks/dev.txt
ifdef LOCKED
	$(PIP) install --require-hashes --no-deps --no-build-isolation -r locks/dev.txt
else
	$(PIP) install -c constraints.txt -e '.[dev]'
endif
	@touch $@

setup: $(READY)  ## Create .venv with everything, in the versions of constraints.txt (LOCKED=1 checks the hash of each file)

system:  ## Install what pip cannot: Chromium for the tests of pages, libusb for Open3D (Debian, as root)
	apt-get update -qq
	apt-get install -y -qq --no-install-recommends chromium chromium-driver libusb-1.0-0

phantom: $(CORE)  ## Render the colon that training uses when there is no C3VD
	$(BIN)/col3d prepare data=phantom $(ARGS)

train: $(CORE)  ## Train and evaluate Col3D-MTL on the phantom (ARGS="key=value ..." changes options)
	$(BIN)/python train.py $(ARGS)

app: $(DEMO)  ## Open the newest trained network as a page in the browser, on this machine alone
	$(BIN)/col3d demo $(ARGS)

benchmark: $(CORE)  ## Run the paper's experiments and report them (PRESET=smoke|laptop|paper DATA=c3vd ROOT=path)
	$(BIN)/col3d benchmark preset=$(PRESET) data=$(DATA) $(if $(ROOT),data.root=$(ROOT)) $(ARGS)

speed: $(READY)  ## Time networks, metrics, geometry, start-up and data beside twins and floors (DATA=c3vd ROOT=path)
	$(BIN)/python -m benchmarks.speed --data $(DATA) $(if $(ROOT),--root $(ROOT)) $(ARGS)
	@if $(BIN)/python -c 'import sys, torch; sys.exit(not torch.cuda.is_available())'; then $(BIN)/python -m benchmarks.gpu speed-gpu; fi

test: $(READY) lint  ## Run linters, type checks, unit tests, laws, references and one small training
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m "not end_to_end" $(ARGS)

test-all: test  ## The same, then the README's commands, notebooks, pages in a browser, the wheel, kills, sweeps, two processes
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m end_to_end $(ARGS)

test-oldest:  ## The unit tests again on the oldest torch that works, in .venv-oldest (6 GB)
	$(PYTHON) -m venv .venv-oldest
	grep -vE '^(torch|torchvision|triton|nvidia-.*|cuda-.*)==' constraints.txt > .venv-oldest/constraints.txt
	.venv-oldest/bin/python -m pip --quiet install -c .venv-oldest/constraints.txt $(OLDEST) -e '.[dev]'
	OMP_NUM_THREADS=1 .venv-oldest/bin/python -m pytest -n 2 -m "not end_to_end" $(ARGS)

test-slurm: $(READY)  ## Run sweeps on a SLURM of this machine (root; apt-get install slurm-wlm munge; 8 minutes)
	$(BIN)/python tests/slurm/trial.py

lint: $(READY)  ## Check style, types and the layers of the package
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)  ## Rewrite the code in the project's style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(READY)  ## Build the pages of docs/ and the API into docs/_build/html, strictly and offline
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

clean:  ## Remove .venv and caches; data and runs stay
	rm -rf .venv .venv-oldest .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
