# make demo   the sample flight in an environment of its own: base install, no PyTorch
# make blender-env   Blender from PyPI in an environment of its own (it wants Python 3.11), for `--renderer blender`
# make test   linters, types, layers and tests, with every extra that the tests need
#
# PYTHON=python3.12         another interpreter, 3.11 or newer
# JOBS=4                    processes that run the tests, of one thread each for PyTorch; 3 unless told, for two cores:
#                           some tests wait for a stream; `pytest` by itself takes one
# TORCH_INDEX=URL           where `make test` also looks for PyTorch: the CPU index that its install page names
#                           spares the CUDA packages

PYTHON ?= python3
JOBS ?= 3
TORCH_INDEX ?=
EXTRAS := test,train,exr,ort,cluster,px4,ardupilot,ros,report,view,clouds,rasters,browser,live

BIN := .venv/bin
DEMO_BIN := .venv-demo/bin
PIP_INSTALL := -m pip install --disable-pip-version-check --quiet --constraint constraints.txt
NEW_ENOUGH := import sys; sys.version_info >= (3, 11) or sys.exit("flightdepth needs Python 3.11 or newer, got " + sys.version.split()[0] + ": make PYTHON=python3.11 ...")

BLENDER_PYTHON ?= python3.11

.PHONY: demo test test-slow lint compiled blender-env

demo: .venv-demo/installed
	$(DEMO_BIN)/flightdepth demo

test: .venv/installed
	@$(MAKE) --no-print-directory --jobs=2 lint compiled
	OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --numprocesses $(JOBS) --dist loadfile --max-worker-restart 0

test-slow: lint
	$(BIN)/python -m pytest -m slow --timeout 3600

lint: .venv/installed
	$(BIN)/ruff check src tests benchmarks ros2
	$(BIN)/ruff format --check src tests benchmarks ros2
	$(BIN)/mypy
	$(BIN)/lint-imports

# What tests import, and what they render with, is compiled once beside `lint`: else each of their processes does it, for
# a minute and a half. Errors show when tests run.
compiled: .venv/installed
	@PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --collect-only -q >/dev/null 2>&1 || true

blender-env: .venv-blender/installed

.venv-blender/installed:
	$(BLENDER_PYTHON) -m venv .venv-blender
	.venv-blender/bin/python -m pip install --disable-pip-version-check --quiet 'bpy==4.5.*'
	.venv-blender/bin/python -c 'import bpy; print("Blender", bpy.app.version_string)'
	@touch $@

# The stamps: nothing is installed again until what is to be installed changes.
.venv/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c '$(NEW_ENOUGH)'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python $(PIP_INSTALL) --no-compile $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) torch
	$(BIN)/python $(PIP_INSTALL) --no-compile --editable '.[$(EXTRAS)]'
	@touch $@

.venv-demo/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c '$(NEW_ENOUGH)'
	test -x $(DEMO_BIN)/python || $(PYTHON) -m venv .venv-demo
	$(DEMO_BIN)/python $(PIP_INSTALL) --editable .
	@touch $@
