# One word for each chore. `make demo` and `make test` need Python 3.11 or newer, pip and make, nothing else.

PYTHON ?= python3
DEMO_OUT ?= demo
UV ?= uv

BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: help demo demo-rig firmware test test-long test-all check generate bench accuracy docs lock clean environment

help:  ## list the chores
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 20

demo: $(INSTALLED)  ## identify the simulated motor and write a report; DEMO_OUT=DIR says where
	$(BIN)/servobench run --overwrite --out "$(DEMO_OUT)"

firmware:  ## build the firmware of the open rig with avr-gcc; firmware/build/rig-500000.hex is flashed with `make -C firmware flash`
	$(MAKE) -C firmware

demo-rig: $(INSTALLED)  ## the same with that firmware in simavr at a pseudo-terminal; needs Debian's packages of .ci/run
	$(BIN)/python -m tests.rig.simavr.demo --overwrite --out "$(DEMO_OUT)-rig"

test: $(INSTALLED)  ## run the tests, four files at a time, as many of them wait; ARGS='-k pattern' is passed on to pytest
	$(BIN)/python -m pytest --numprocesses 4 --dist loadfile --no-loadscope-reorder $(ARGS)

test-long: $(INSTALLED)  ## run what takes long and a test of `make test` shows in part: many runs, thousands of damaged files
	$(BIN)/python -m pytest --numprocesses 4 --dist worksteal -m long $(ARGS)

test-all:  ## run both in one go: what waits and what computes, short and long, in turns, and each file read once
	$(MAKE) test ARGS='-m "long or not long" $(ARGS)'

check: $(INSTALLED)  ## format, lint, types, import directions, lock file, docs
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/check_lock.py
	$(BIN)/python tools/check_docs.py
	$(BIN)/python tools/check_docstrings.py
	$(BIN)/python tools/check_promises.py
	$(BIN)/python tools/count_lines.py

generate: $(INSTALLED)  ## renew the files that are written from the code: help texts, reference pages, the example's recording
	set -e; for tool in tools/write_*.py; do $(BIN)/python $$tool; done

bench: $(INSTALLED)  ## measure speed, accuracy and coverage
	$(BIN)/python bench/run.py $(ARGS)

accuracy: $(INSTALLED)  ## accuracy beside the bound, coverage, verdicts, over many runs; ARGS='--runs 100 --rows encoder'; hours
	$(BIN)/python bench/accuracy.py $(ARGS)

docs: $(INSTALLED)  ## build the documentation as HTML in build/docs; warnings are errors, and nothing is fetched
	$(BIN)/python tools/check_docs.py
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --nitpicky --quiet -b html docs build/docs

lock:  ## renew requirements.lock with uv; ARGS=--upgrade takes newer versions too
	$(UV) pip compile --quiet --universal --generate-hashes --all-extras --group dev \
	    --custom-compile-command "make lock" $(ARGS) pyproject.toml --output-file requirements.lock
	$(PYTHON) tools/check_lock.py

clean:  ## remove the environment, caches and the demo's output
	rm -rf .venv .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist demo demo-rig firmware/build
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

environment: $(INSTALLED)  ## create or renew .venv

$(INSTALLED): requirements.lock pyproject.toml | $(BIN)/python
	@echo "setting up .venv; this is done once"
	$(PIP) --no-compile --require-hashes -r requirements.lock
	$(PIP) --no-deps --no-build-isolation -e .
	@# pip would compile one file after the other; some aren't meant for this Python, which it doesn't tell either.
	@$(BIN)/python -m compileall -qq -j 0 src .venv/lib/python*/site-packages || true
	@touch $@

# Debian packs ensurepip apart (python3-venv); without it the new environment has no pip, and PYTHON's own does the work.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "servobench needs Python 3.11 or newer; for instance: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $$($(PYTHON) -c 'from ensurepip import bootstrap' 2>/dev/null || echo --without-pip) .venv || { rm -rf .venv; exit 1; }

PIP = $(shell $(BIN)/python -c 'import pip' 2>/dev/null && echo $(BIN)/python || echo $(PYTHON)) -m pip \
    --python $(BIN)/python --disable-pip-version-check install --quiet
