# For a fresh clone (Python >= 3.11, pip and make are all it takes); each sets everything up on first use:
#   make score   runs the paper's evaluation
#   make test    passes the tests
#   make quick   passes the fast ones, in under a minute
#   make coverage  which lines the tests reach, file by file
#   make docs    builds the site into build/site; a broken link fails
#   make check   lint, format, types, import contracts, circles, dead names
PYTHON ?= python3
VENV ?= .venv
# Half as many again as there are cores: some tests wait for the clock, the others drive meanwhile.
TEST_PROCESSES ?= $(shell expr \( $$(getconf _NPROCESSORS_ONLN) \* 3 + 1 \) / 2)
OUT ?= results/$(shell date +%Y%m%d-%H%M%S)
BIN := $(VENV)/bin
# Python compiles a package when it is first imported: most of what is installed never is. It keeps the result, whatever
# the environment says: dozens of processes of the tests import the same.
export PYTHONDONTWRITEBYTECODE :=
INSTALL = $(BIN)/python tools/install.py

# tests/conftest.py puts the files that take longest first.
IN_PARALLEL = -n $(TEST_PROCESSES) --dist loadfile --no-loadscope-reorder
TEST_MINUTES := 6

# The formulas, the files and the words, without a simulator; what is slow in these files is left out by name.
QUICK := tests/test_errors.py tests/settings/test_settings.py tests/settings/test_config.py tests/test_trajectory.py tests/test_text.py \
  tests/docs/test_glossary.py tests/docs/test_documents.py tests/tools/test_house_check.py tests/method/test_criticality.py \
  tests/method/test_score.py tests/method/test_score_terms.py tests/method/test_collision_avoidance.py \
  tests/method/test_trajectory_field.py tests/method/test_measures.py tests/method/test_severity.py \
  tests/method/test_plausibility.py tests/scenario/test_expression.py tests/scenario/test_sampling.py \
  tests/scenario/test_scenario_file.py tests/cosim/test_contact.py tests/report/test_report_words.py \
  tests/report/test_report_tables.py tests/report/test_ledger.py

.PHONY: score test quick campaign coverage check docs install clean

score: $(VENV)/.installed
	$(BIN)/sumo-eval run --out $(OUT)

test: $(VENV)/.installed-dev
	@echo "The tests take about $(TEST_MINUTES) minutes on two idle cores."
	$(BIN)/python -m compileall -q -j 0 sumo_eval
	$(BIN)/python -m sumo_eval.record.loops
	$(BIN)/python -m pytest $(IN_PARALLEL)

quick: $(VENV)/.installed-dev
	$(BIN)/python -m pytest $(IN_PARALLEL) -k "not shipped_table_is_what_the_tool" $(QUICK)

campaign: $(VENV)/.installed-dev
	$(BIN)/python tools/run_campaign.py

coverage: $(VENV)/.installed-dev
	$(BIN)/python -m coverage run -m pytest $(IN_PARALLEL)
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage report

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/house_check.py --facts

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "sumo_eval needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(INSTALL) --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/bin/python
	$(INSTALL) --editable '.[dev]'
	$(INSTALL) --no-deps 'tasi==0.15.4' || \
	  echo "The wheel tasi, a recording, cannot be had: the example on recorded people is skipped."
	@touch $@ $(VENV)/.installed

docs: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m campaign tests/docs/test_site_builds.py

clean:
	rm -rf $(VENV) build dist
