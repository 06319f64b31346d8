# `make run`  sets everything up and runs the quick benchmark; ends by naming its report.
# `make test` sets everything up, then lint, types and tests.
# Needs Python 3.11 and a C++ compiler; the first call installs into .venv (about 3 GB).

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
KERNELS := $(shell find mattgs_ops/splat/_kernels mattgs_ops/sfm/colmap/_kernels -type f)
# every stamp depends on what the extension and the metadata are built from
BUILD_INPUTS := pyproject.toml CMakeLists.txt $(KERNELS)
# the editable installation lists the modules: it is made anew when one was added, moved or removed
MODULES := $(VENV)/.modules-$(shell find mattgs_ops tasks flows reports -name '*.py' | LC_ALL=C sort | cksum | cut -d' ' -f1)
PIP := $(BIN)/python -m pip --disable-pip-version-check install -qq --no-compile
# $(call INSTALL,EXTRA): the engine is built meanwhile. Named one by one the libraries are resolved in a third of the time that
# pip takes for them as a package's own. pip chooses the files, by its settings; uv, which unpacks many at a time, installs
# just those; where it cannot, pip does.
LIBRARIES = $(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
  print(*p["dependencies"], *p["optional-dependencies"].get("$(1)", []), sep="\n")'
CHOSEN = $(BIN)/python -c 'import json; found = json.load(open("$(VENV)/chosen.json", "rb"))["install"]; \
  form = "{0[metadata][name]} @ {0[download_info][url]} --hash=sha256:{0[download_info][archive_info][hashes][sha256]}"; \
  print(*map(form.format, found), sep="\n")'
UNPACK = $(PIP) --dry-run --report $(VENV)/chosen.json --requirement $(VENV)/libraries.txt && \
  $(CHOSEN) > $(VENV)/chosen.txt && \
  UV_CACHE_DIR=$(VENV)/unpacked $(BIN)/python -m uv pip install --quiet --python $(BIN)/python --no-deps --require-hashes \
    --requirement $(VENV)/chosen.txt
INSTALL = echo 'make: installs the libraries (3 GB) and builds the engine, for some minutes'; \
  $(call LIBRARIES,$(1)) > $(VENV)/libraries.txt || exit 1; \
  $(PIP) --no-deps --editable . & engine=$$!; \
  { $(UNPACK); } || { echo 'make: uv could not install them, pip goes on'; $(PIP) --requirement $(VENV)/libraries.txt; }; \
  libraries=$$?; rm -rf $(VENV)/unpacked; \
  wait $$engine && exit $$libraries
# on all cores, where pip would take one; not the libraries' own tests, some of which are of another Python's syntax, nor large
# parts of them of which next to nothing is imported; our own modules, too, as the environment may forbid to do it later
UNUSED := tests?|testing|databricks|moto|sklearn|pip|mypyc?|setuptools|apprise/plugins|sympy/physics|onnxruntime/transformers
UNUSED := $(UNUSED)|torch/_inductor/(codegen|fx_passes|kernel)|dask/(array|dataframe)
COMPILE := $(BIN)/python -m compileall -q -j 0 -x '/($(UNUSED))/' $(VENV)/lib mattgs_ops tasks flows reports \
  benchmarks > /dev/null || true

.PHONY: run test quick-test lint types format install dev clean help

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/'

run: $(VENV)/.installed ## run the quick benchmark on the bundled captures
	$(BIN)/mattgs run $(ARGS)

# a file's tests share fixtures and stay on one core; those that take longest begin (tests/conftest.py)
PYTEST := $(BIN)/python -m pytest --numprocesses logical --dist loadfile --no-loadscope-reorder

# pytest rewrites each assert to tell more when it fails, for half a minute of CPU: only what has failed runs again with that
test: lint types $(VENV)/.installed-dev ## lint, types and all tests
	$(PYTEST) --assert=plain || { echo "make: what failed, again with details"; \
	  $(PYTEST) --last-failed --last-failed-no-failures none; exit 1; }

quick-test: $(VENV)/.installed-dev ## tests without those marked slow
	$(PYTEST) -m "not slow"

lint: $(VENV)/.installed-dev ## ruff, rules and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev ## mypy, strict
	$(BIN)/mypy --num-workers auto

format: $(VENV)/.installed-dev ## let ruff rewrite what it can
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

install: $(VENV)/.installed ## the virtual environment for running
dev: $(VENV)/.installed-dev ## the virtual environment for developing

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "make: Python 3.11 was not found; install it or set PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || \
	  { echo "make: Python 3.11 is needed, found $$($(PYTHON) --version); set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@$(PIP) --upgrade 'pip>=25.3' 'uv>=0.9' || echo "make: pip was not upgraded, uv not installed: all takes minutes longer"

$(MODULES): | $(VENV)/bin/python
	@rm -f $(VENV)/.modules-*
	@touch $@

$(VENV)/.installed: $(VENV)/bin/python $(BUILD_INPUTS) $(MODULES)
	@$(call INSTALL)
	$(COMPILE)
	@touch $@

$(VENV)/.installed-dev: $(VENV)/bin/python $(BUILD_INPUTS) $(MODULES)
	@$(call INSTALL,dev)
	$(COMPILE)
	@touch $@ $(VENV)/.installed

clean: ## remove build products and the virtual environment; results stay
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .mypy_cache
