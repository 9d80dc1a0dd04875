# The two commands: `make run` sets up and watches the breaker hammer, `make test` sets up and passes the tests.
PYTHON ?= python3
ROS ?= jazzy
VENV ?= .venv$(if $(filter kilted,$(ROS)),-kilted)
BIN := $(VENV)/bin
PINS := -c constraints/python.txt -c constraints/$(ROS).txt
ARGS ?=

export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: run test test-fast test-browser test-ros lint bench colcon clean

run: $(VENV)/.run
	$(BIN)/mech-twin run $(ARGS)

test: lint
	$(BIN)/python -m pytest -m "not browser" $(ARGS)

test-fast: $(VENV)/.test
	$(BIN)/python -m pytest -m "not browser and not slow" $(ARGS)

test-browser: $(VENV)/.test
	$(BIN)/python -m pytest -m browser $(ARGS)

test-ros: $(VENV)/.test
	$(BIN)/python -m pytest test/messages test/nodes -m "not slow" $(ARGS)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.bench
	$(BIN)/python -m pytest benchmarks --benchmark-only $(ARGS)

colcon: $(VENV)/.test
	bash test/packaging/colcon_build.sh $(BIN)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q "pip>=24" "setuptools>=77"

$(VENV)/.run: setup.py constraints/python.txt constraints/$(ROS).txt | $(VENV)/bin/python
	$(BIN)/python -m pip install -q -e ".[$(ROS)]" $(PINS)
	touch $@

$(VENV)/.test: setup.py constraints/python.txt constraints/$(ROS).txt | $(VENV)/bin/python
	$(BIN)/python -m pip install -q -e ".[$(ROS),cluster,test]" $(PINS)
	touch $@ $(VENV)/.run

$(VENV)/.bench: $(VENV)/.test
	$(BIN)/python -m pip install -q -e ".[$(ROS),bench]" $(PINS)
	touch $@

clean:
	rm -rf $(VENV) build install log
