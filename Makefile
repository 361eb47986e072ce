PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Images of containers often set it. Each process of the tests would then compile every module again.
export PYTHONDONTWRITEBYTECODE =

.PHONY: install demo test long conclusions bench lint types wheel docs pictures clean

$(BIN)/gpmodel: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[all]"
	touch $@

$(BIN)/pytest: $(BIN)/gpmodel
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@

install: $(BIN)/gpmodel

demo: $(BIN)/gpmodel
	$(BIN)/gpmodel demo --out demo-report

test: $(BIN)/pytest
	$(BIN)/pytest -n auto --dist loadfile

long: $(BIN)/pytest
	$(BIN)/pytest -n auto --dist loadfile -m 'long and not slow'

conclusions: $(BIN)/pytest
	$(BIN)/pytest -m slow tests/experiments/test_chapter5_outside.py tests/experiments/test_hexapod_experiment.py
	$(BIN)/pytest -n auto -m slow tests/discovery/test_measured_robots.py tests/discovery/test_loop.py
	$(BIN)/pytest -m slow tests/experiments/test_thesis_experiments.py -k 'slot_histogram_points_at or every_machine or both_models'

bench: $(BIN)/pytest
	$(BIN)/python -m experiments.bench.run --jobs 2

wheel: $(BIN)/pytest
	.ci/installed $(PYTHON)

lint: $(BIN)/pytest
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(BIN)/pytest
	$(BIN)/mypy

docs: $(BIN)/pytest
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

pictures: $(BIN)/pytest
	$(BIN)/python docs/make/pictures.py

clean:
	rm -rf $(VENV) demo-report site
