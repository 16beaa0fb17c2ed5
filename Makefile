# Two commands for people: `make demo` and `make test`. Both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# What is installed: the tools for people, and on top of them those for developers.
GROUND := $(VENV)/.ground
DEV := $(VENV)/.dev

.PHONY: demo test lint setup clean

$(GROUND): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[ground]"
	touch $@

$(DEV): $(GROUND)
	$(PIP) --editable ".[ground,dev]"
	touch $@

setup: $(DEV)

demo: $(GROUND)
	$(BIN)/hopper run --surface quartz_sand --hops 3 --energy-j 18 --out out/demo

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest

clean:
	rm -rf $(VENV) out
