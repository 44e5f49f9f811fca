# On a fresh machine with Python 3.11 or newer: `make demo`, `make test`, `make check`, `make docs`.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test nightly mutants check docs drawings clean

# `make demo`: the paper's whole study on a simulated DeltaLab platform; says where the report is.
demo: .venv/.installed
	$(BIN)/cpcal demo -o demo --force

# a file's tests stay with one worker, which makes what they share once; files in their order, the long ones early
test: .venv/.installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

# `make nightly`: the longer sweeps, which `make test` leaves out or does a part of
nightly: .venv/.installed-dev
	$(BIN)/python -m pytest -n auto -m nightly --timeout 3600
	CPCAL_PLANTED=20000 CPCAL_EXAMPLES=250 $(BIN)/python -m pytest -n auto --timeout 36000 tests/solver/test_planted.py tests/checker/valid/test_rule.py
	mkdir -p build
	$(BIN)/python -m benchmarks.damaged_runs --count 10000 --log build/damaged_runs.jsonl
	$(BIN)/python -m benchmarks.kernel_soundness --pairs 10000000
	$(MAKE) mutants

# `make mutants`: small changes of a copy of the code, each of which the tests must notice; part of `make nightly`
mutants: .venv/.installed-dev
	$(BIN)/python -m benchmarks.mutants_of_code --processes 2

check: .venv/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# `make drawings`: the imports of today, for docs/architecture.md; its table has the counts that are printed.
drawings: .venv/.installed-dev
	$(BIN)/python docs/draw_imports.py -o docs/pictures/imports-today.svg
	$(BIN)/python docs/draw_imports.py --inside cpcal.solver -o docs/pictures/imports-solver.svg
	$(BIN)/python docs/draw_imports.py --folders
	$(BIN)/python docs/trace_rooms.py file
	$(BIN)/python docs/trace_rooms.py image

# `make docs`: the documentation as a site in build/docs; runs the examples of its gallery.
docs: .venv/.installed-docs
	MPLBACKEND=agg $(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet --conf-dir docs . build/docs
	@echo "build/docs/docs/index.html"

# Modules are compiled when they are first imported, which few of those installed ever are: half the time of an install.
export PYTHONDONTWRITEBYTECODE :=

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/.installed: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable .
	touch $@

.venv/.installed-dev: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev]'
	touch $@ .venv/.installed

.venv/.installed-docs: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[docs]'
	touch $@ .venv/.installed

clean:
	rm -rf .venv demo dist build docs/gallery
