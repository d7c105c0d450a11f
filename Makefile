# Two commands for a fresh clone (Python >= 3.11, pip and make are all it takes):
#   make score   sets everything up and runs the paper's evaluation
#   make test    sets everything up and passes the tests
PYTHON ?= python3
VENV ?= .venv
OUT ?= results/$(shell date +%Y%m%d-%H%M%S)
BIN := $(VENV)/bin

.PHONY: score test campaign check install clean

score: $(VENV)/.installed
	$(BIN)/sumo-eval run --out $(OUT)

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile

campaign: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m campaign

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "sumo_eval needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) build dist
