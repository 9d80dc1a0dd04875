# SPDX-License-Identifier: Apache-2.0
# The two commands: `make run` sets up and watches the breaker hammer, `make test` sets up and passes the tests.
PYTHON ?= python3
PYTHON_MINIMUM := 3.11
ROS ?= jazzy
VENV ?= .venv$(if $(filter kilted,$(ROS)),-kilted)
BIN := $(VENV)/bin
TOOLS := .venv-tools
PINS := -c constraints/python.txt -c constraints/$(ROS).txt
HASHED ?= # any text: install by hashes, and nothing else (docs/supply-chain.md)
HASHES := constraints/hashes/$(ROS).txt
EXTRAS := $(ROS),view,plots,tables
INSTALL_HASHED = $(BIN)/python -m pip install -q --require-hashes --no-deps -r $(HASHES) && \
  $(BIN)/python -m pip install -q --no-deps --no-build-isolation -e .
READERS := test/recording/npm
comma := ,
# rooms, and files of others, whose tests neither talk over topics nor watch the clock; the others run apart from them,
# file by file on two cores, each test in a ROS domain of its own
# the longest first, so that no core waits at the end
QUIET_ROOMS := studies engine fmi golden literature machines measurements mechanics messages packaging parameters parts
QUIET_FILES := $(addprefix cli/test_,completion.py consequences.py errors.py measurement_commands.py monitor.py pages.py \
    plain_recordings.py readme.py recording_losses.py reproduce.py run_options.py simulate_residuals.py story_recording.py study.py tables.py) \
  $(addprefix recording/test_,bag_samples.py bag_writer.py compressed_bags.py false_index.py foreign_readers.py fuzz.py joint_states.py \
    message_writer.py recovery.py ros_distro.py schemas.py sqlite_bag.py) \
  $(addprefix reliability/test_,extreme_configurations.py mutated_configurations.py mutated_files.py mutated_messages.py \
    poor_surroundings.py soak_report.py) \
  $(addprefix view/test_,annotations.py decimation.py labels.py rerun_scene.py) view/bench/test_lanes.py \
  $(addprefix test_,captions.py changed_values.py kernel_cache.py kernel_sources.py output_file.py random_configurations.py terminal_output.py)
LONGEST := test_random_configurations.py reliability/test_poor_surroundings.py
QUIET := $(wildcard $(addprefix test/,$(LONGEST) $(filter-out $(LONGEST),$(QUIET_ROOMS) $(QUIET_FILES))))
SHARED := -n 2 --dist loadfile --no-loadscope-reorder $(QUIET)
ALONE := -n 2 --dist loadfile test $(addprefix --ignore=,$(QUIET) test/reliability)
# these kill and stop processes of a run, beside which they listen: in a process that has not listened to others before,
# and with nothing beside them
FAULTS := -n 2 --dist loadfile test/reliability $(addprefix --ignore=,$(filter test/reliability/%,$(QUIET)))
PYTEST := $(BIN)/python -m pytest
# without site: what it starts finds the libraries of the distribution that it runs, not of this one
BESIDE := $(BIN)/python -S test/side_by_side.py
MAIN := not browser and not slow
REST := not browser and slow
ARGS ?=

export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# as the command has it: matrices are small, and threads of their own wait for each other
export OPENBLAS_NUM_THREADS ?= 1
# tests are read once and not in each process that collects them or starts a program
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test test-fast test-rest test-all kernels explore test-browser test-ros test-oldest lint coverage bench
.PHONY: colcon test-launch mutation hooks audit sbom licences hashes docs clean soak faults

run: $(VENV)/.run
	$(BIN)/mech-twin run $(ARGS)

test: kernels # every room, without the slow tests
	$(BESIDE) $(PYTEST) -m "$(MAIN)" $(SHARED) $(ARGS) beside $(PYTEST) -m "$(MAIN)" $(ALONE) $(ARGS)
	$(PYTEST) -m "$(MAIN)" $(FAULTS) $(ARGS)

test-fast: $(VENV)/.test # of those the ones without topics
	$(PYTEST) -m "$(MAIN)" $(SHARED) $(ARGS)

test-rest: $(VENV)/.test # what `make test` leaves out
	$(PYTEST) -m "$(REST)" $(FAULTS) $(ARGS)
	$(BESIDE) $(PYTEST) -m "$(REST)" $(SHARED) $(ARGS) beside \
	  $(PYTEST) -m "$(REST)" $(ALONE) $(ARGS) then make test-browser then make colcon then make test-ros ROS=kilted

test-all:
	$(MAKE) lint
	$(MAKE) test
	$(MAKE) test-rest

kernels: $(VENV)/.test # all cores compile, and no kernel twice, before tests run side by side
	$(BIN)/python test/compile_kernels.py

explore: $(VENV)/.test # the property tests with examples of their own each time
	$(PYTEST) -m "not browser" $(SHARED) --hypothesis-profile=explore $(ARGS)

test-browser: $(VENV)/.test
	$(PYTEST) -m browser test/view $(ARGS)

test-ros: $(VENV)/.test
	$(PYTEST) -n 2 --dist loadfile test/messages test/nodes -m "not slow" $(ARGS)

test-oldest: $(TOOLS)/.tools # the fast tests with the oldest versions that setup.py allows
	PYTHON=$(PYTHON) bash .ci/oldest $(TOOLS)/bin $(ARGS)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/plain_words.py

coverage: $(VENV)/.test # without the slow tests; lines inside compiled kernels are not seen, mutation testing looks at those
	$(PYTEST) -m "not browser and not slow" --timeout=600 --cov --cov-report=term:skip-covered --cov-report=xml $(ARGS)

bench: $(VENV)/.bench # writes the tables of docs/proof/performance.md; ARGS: groups, all without; --list names them
	$(BIN)/python benchmarks/performance.py $(ARGS)

colcon: $(VENV)/.test
	bash test/packaging/colcon_build.sh $(BIN)

test-launch: $(VENV)/.test # launch library, tf2_msgs and fmusim come from their sources, the library for Windows runs where wine is
	bash .ci/launch_tests.sh $(BIN) $(ARGS)
	$(PYTEST) -q test/fmi -k needs_no_python
	bash .ci/fmusim.sh $(BIN)
	bash .ci/tf_tests.sh $(BIN) $(ARGS)

mutation: $(VENV)/.test $(TOOLS)/.tools # ARGS: targets of .ci/mutation.toml; all without
	$(TOOLS)/bin/python .ci/mutate.py $(BIN) $(TOOLS)/bin $(ARGS)

hooks: $(VENV)/.test $(TOOLS)/.tools
	$(TOOLS)/bin/pre-commit install --hook-type pre-commit --hook-type commit-msg

audit: $(VENV)/.test $(TOOLS)/.tools # asks the vulnerability service over the network
	$(TOOLS)/bin/python .ci/audit.py $(BIN) $(TOOLS)/bin

sbom: $(VENV)/.run $(TOOLS)/.tools
	mkdir -p build
	$(TOOLS)/bin/python .ci/sbom.py $(BIN) $(TOOLS)/bin build/sbom.cdx.json

licences: $(VENV)/.run $(TOOLS)/.tools
	$(TOOLS)/bin/python .ci/licences.py $(BIN) $(TOOLS)/bin docs/licences.md

hashes: $(TOOLS)/.tools # asks the package index; rewrites the pins with hashes
	$(TOOLS)/bin/python .ci/hashes.py $(TOOLS)/bin

SOAK := --minutes 10 --pace realtime --view --step-s 0.002
soak: $(VENV)/.test # ten minutes by the wall clock, recorded and shown: memory of each process, balances, lag, losses
	$(BIN)/python benchmarks/reliability/soak.py $(or $(ARGS),$(SOAK))

faults: $(VENV)/.test # every signal at every moment of every verb, and every number of a configuration at its extremes
	$(BIN)/python benchmarks/reliability/signals.py $(ARGS)
	$(BIN)/python benchmarks/reliability/extreme_configurations.py $(ARGS)

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; found = sys.version_info[:2]; need = tuple(map(int, "$(PYTHON_MINIMUM)".split("."))); \
	  sys.exit(0 if found >= need else "Python $(PYTHON_MINIMUM) or newer is needed; found %d.%d (%s); name another: make PYTHON=python3.12" % (found + (sys.executable,)))'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q "pip>=24" "setuptools>=77"

$(VENV)/.run: setup.py constraints/python.txt constraints/$(ROS).txt | $(VENV)/bin/python
	@echo "installing 1.3 GB of packages into $(VENV), which takes some minutes the first time"
	$(if $(strip $(HASHED)),$(INSTALL_HASHED),$(BIN)/python -m pip install -q -e ".[$(EXTRAS)]" $(PINS))
	touch $@

$(VENV)/.test: setup.py constraints/python.txt constraints/$(ROS).txt | $(VENV)/bin/python
	@echo "installing 2.3 GB of packages into $(VENV), which takes some minutes the first time"
	$(if $(strip $(HASHED)),$(INSTALL_HASHED),$(BIN)/python -m pip install -q --no-compile -e ".[$(EXTRAS),cluster,alerts,foxglove,fmu,life,$(if $(filter jazzy,$(ROS)),cuda$(comma))test]" $(PINS))
	touch $@ $(VENV)/.run
	$(MAKE) -s $(READERS)/node_modules

$(VENV)/.docs: constraints/docs.txt $(VENV)/.run
	$(BIN)/python -m pip install -q -e ".[$(ROS),docs]" $(PINS) -c constraints/docs.txt
	touch $@

# the JavaScript readers that recordings are proved against; without npm their test is skipped, and says so
$(READERS)/node_modules: $(READERS)/package-lock.json
	@if command -v npm >/dev/null; then npm ci --prefix $(READERS) --prefer-offline --loglevel=error --no-audit --no-fund --ignore-scripts && touch $@; \
	  else echo "npm not found: the test with the JavaScript readers will be skipped"; fi

$(VENV)/.bench: $(VENV)/.test
	$(BIN)/python -m pip install -q -e ".[$(ROS),bench]" $(PINS)
	touch $@

$(TOOLS)/.tools: constraints/tools.txt | $(VENV)/bin/python
	$(BIN)/python -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install -q cosmic-ray cyclonedx-bom pip-audit pip-licenses pre-commit towncrier uv -c constraints/tools.txt
	touch $@

docs: $(VENV)/.docs # the site in build/site; a broken link ends it
	$(BIN)/python -m mkdocs build --strict $(ARGS)

clean:
	rm -rf $(VENV) $(TOOLS) $(READERS)/node_modules build install log
