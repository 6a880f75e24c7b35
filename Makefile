# `make demo` and `make test` need nothing but Python >= 3.11 and make; both build .venv when it is missing.

VENV := .venv
BIN := $(VENV)/bin
SOURCES := coopmm_jax tuning experiments tests

# The first interpreter on the path that is new enough; `make PYTHON=/path/to/python3.12 ...` overrides it.
NEW_ENOUGH := -c 'import sys; sys.exit(sys.version_info < (3, 11))'
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	"$$p" $(NEW_ENOUGH) 2>/dev/null && { echo "$$p"; break; }; done)

.PHONY: demo test types tests docs clean

demo: $(VENV)/.installed
	$(BIN)/python -m experiments.reproduce_paper --out results/paper
	$(BIN)/coopmm tune sensed --tuning.budget 60 --out results/demo --overwrite

# What takes a second comes first; types are checked beside the tests, which leave a core idle now and then.
test: $(VENV)/.installed-test
	$(BIN)/ruff check
	$(BIN)/ruff format --check --quiet
	$(BIN)/lint-imports --no-logo --no-cache
	$(MAKE) --no-print-directory --jobs 2 types tests

types: $(VENV)/.installed-test
	$(BIN)/basedpyright --pythonpath $(BIN)/python

# Two workers, each keeping whole files, so that a file's compiled functions are shared by its tests. Python's own
# compiled files are written even where the environment asks for none: compiling what is imported takes each of some
# fifty processes 5 s.
tests: $(VENV)/.installed-test
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# The site in build/site: notebooks are run at full size, which takes minutes, and again only after they have changed.
NOTEBOOKS := $(patsubst experiments/notebooks/%,build/notebooks/%,$(wildcard experiments/notebooks/*.ipynb))

docs: $(VENV)/.installed-test $(NOTEBOOKS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "the documentation is in build/site/index.html"

# Kernels warn that they talk without encryption, which they do on this machine alone.
build/notebooks/%.ipynb: experiments/notebooks/%.ipynb | $(VENV)/.installed-test
	$(BIN)/python -m nbconvert --execute --ExecutePreprocessor.extra_arguments=--log-level=40 --to notebook --output-dir build/notebooks $<

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find $(SOURCES) -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "make: needs Python 3.11 or newer on the path, or make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# Python compiles what is imported when it is; compiling every file of every package takes a third of an installation.
# The stamps stand beside whatever .venv already holds, so an environment made by hand is completed, not rebuilt. The pip
# that comes with Python 3.11 takes twice as long as today's to find 150 packages;
# setuptools stands in the environment, as pip would else install it once more to build the package.
$(VENV)/.installed: EXTRAS :=
$(VENV)/.installed-test: EXTRAS := [test,docs]
$(VENV)/.installed $(VENV)/.installed-test: pyproject.toml constraints.txt coopmm_jax/__init__.py | $(BIN)/python
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(BIN)/python -m ensurepip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt 'pip>=26' 'setuptools>=77'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-build-isolation --constraint constraints.txt --editable '.$(EXTRAS)'
	@touch $@
