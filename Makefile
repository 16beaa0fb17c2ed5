# Two commands for people: `make demo` and `make test`. Both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# What is installed: the tools for people, and on top of them those for developers.
GROUND := $(VENV)/.ground
DEV := $(VENV)/.dev

# Stamp of the first translation; later ones are for who wants them (`make compile`).
TRANSLATED := $(VENV)/.translated

.PHONY: compile demo test bench check mutation fuzz docs test-kernel test-arm64 lint setup clean

$(GROUND): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[ground]"
	touch $@

$(DEV): $(GROUND)
	$(PIP) --editable ".[ground,dev]"
	touch $@

setup: compile

# Machine code of what each tick runs through. Without a C compiler all runs as well, and missions take twice as long.
compile: $(DEV)
	$(BIN)/hopper compile || echo "no machine code: missions take twice as long"

$(TRANSLATED): | $(DEV)
	$(MAKE) compile
	touch $@

demo: $(GROUND)
	$(BIN)/hopper run --surface quartz_sand --hops 3 --energy-j 18 --out out/demo

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint | $(TRANSLATED)
	$(BIN)/pytest

# One table of what hopper costs and gets right, each row beside its peer: benchmarks/results.md.
bench: compile
	$(PIP) --editable ".[bench]"
	$(BIN)/python -m benchmarks.bench

# All gates: style, types, layers; the tests of what flies against machine code, then all tests by the sources, with
# branch coverage by package; licences of what flies and of what is on the ground; the wheel in a clean environment;
# mutants of the energy chain, the monitors and the core of the estimator.
check: lint compile
	HOPPER_COMPILED=1 $(BIN)/pytest tests/flight tests/mission tests/safety tests/sim_hal tests/chips tests/contract
	$(BIN)/pytest --cov --cov-branch --cov-report=json:out/coverage.json
	$(BIN)/python -m benchmarks.gates coverage out/coverage.json
	$(BIN)/python -m benchmarks.gates licences
	$(BIN)/python -m benchmarks.gates wheel
	$(MAKE) mutation

mutation: $(DEV)
	$(BIN)/mutmut run
	$(BIN)/python -m benchmarks.gates mutants

# Everything that reads what comes from outside, a minute each; what is found joins tests/corpus, which a test reads.
fuzz: $(DEV)
	$(PIP) --editable ".[fuzz]"
	$(BIN)/python -m benchmarks.fuzz

# The documentation as a site in out/site; a link or an anchor that leads nowhere fails it.
docs: $(GROUND)
	$(PIP) --editable ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The drivers on Debian's arm64 kernel, on a computer emulated by QEMU. Needs root (or sudo) on Debian 12 for its packages.
test-kernel: $(DEV)
	PYTHON=$(abspath $(BIN)/python) tests/kernel/prepare.sh out/arm64
	HOPPER_ARM64=$(abspath out/arm64) $(BIN)/pytest -n0 -s tests/kernel

# The flight tests on an arm64 Debian in user-mode emulation.
test-arm64: $(DEV)
	PYTHON=$(abspath $(BIN)/python) tests/kernel/prepare.sh out/arm64
	PYTHON=$(abspath $(BIN)/python) tests/kernel/flight_on_arm64.sh out/arm64

clean:
	rm -rf $(VENV) out
