# make reproduce | make benchmarks | make test | make install | make check | make bench | make docs | make wheel
PYTHON ?= $(shell command -v python3.11 || command -v python3)
PY := .venv/bin/python
ARGS ?=

.PHONY: install reproduce benchmarks test lint check bench docs wheel

install: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11 ..."; exit 2; }
	@$(PY) -c 'import sys, pip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  $(PYTHON) -m venv --clear .venv
	@echo "installing into .venv: PyTorch and what it needs, a few minutes the first time"
	@$(PY) -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e '.[dev,docs]'
	touch $@

# make reproduce ARGS="draws=10 initial.weights_file=tests/golden/initial_weights.npz"
reproduce: install
	$(PY) -m experiments.reproduce $(ARGS)

# make benchmarks ARGS="problems=[rohrs,l1]"
benchmarks: install
	$(PY) -m experiments.benchmarks $(ARGS)

lint: install
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

test: lint
	$(PY) -m pytest -n 2 --dist worksteal -q $(ARGS)

# The site, every cell and every example of the gallery run: docs/_build/html/index.html.
docs: install
	$(PY) -m sphinx -E -j 2 -W --keep-going -q -b html docs docs/_build/html $(ARGS)
	@echo "open docs/_build/html/index.html"

# The slow checks too: torchdiffeq over 20 s, golden numbers at 1 ms.
check: lint
	$(PY) -m pytest -n 2 --dist worksteal -q -m "slow or not slow" $(ARGS)

# Every engine in one run, with JAX and diffrax as peers; writes BENCHMARKS.md.
bench: install
	@$(PY) -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,bench]'
	$(PY) -m experiments.benchmark $(ARGS)

# A wheel, its self check and its tests in a new environment, away from the checkout.
# make wheel PYTHON=python3.13 ARGS="tests/plants tests/contracts"
wheel:
	.ci/wheel $(PYTHON) $(ARGS)
