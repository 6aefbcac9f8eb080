# `make demo` packs a ten-item order, in three simulated worlds too, and audits the plan; `make test` runs the tests.
# Each sets up its own .venv from nothing.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
OUT := out

.PHONY: demo test physics lint types layers slow clean

demo: $(VENV)/.core
	mkdir -p $(OUT)
	$(BIN)/robotpack pack assets/orders/ten.csv --container 0.32x0.32x0.30 \
	  --out $(OUT)/plan.json --html $(OUT)/plan.html --png $(OUT)/plan.png
	$(BIN)/robotpack verify $(OUT)/plan.json

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2

# What comes to physics, without the packages of learning: for a Python on which MuJoCo alone is installed.
physics: $(VENV)/.core
	$(PIP) install --constraint constraints.txt pytest pytest-xdist hypothesis
	$(BIN)/python -m pytest -n 2 tests/sim tests/execution tests/cli/test_execute.py tests/env/test_physics.py \
	  tests/test_without_bullet.py

slow: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 -m slow

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

layers: $(VENV)/.dev
	$(BIN)/lint-imports

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.core: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install --constraint constraints.txt --editable .
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install --constraint constraints.txt --editable '.[dev,bench,ray,train]'
	touch $@ $(VENV)/.core

clean:
	rm -rf $(VENV) $(OUT)
