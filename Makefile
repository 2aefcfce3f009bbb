SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
MAKEFLAGS += --no-builtin-rules
.DEFAULT_GOAL := help

# A python3 of 3.10 to 3.13, and the folder of the environment: make env PYTHON=python3.12 VENV=.venv312
PYTHON ?= python3
VENV ?= .venv

BIN := $(VENV)/bin
STAMPS := $(VENV)/.stamps
PIP := $(BIN)/python -m pip --disable-pip-version-check -qq

# The environment is closed: a sourced ROS, or a process of another environment that runs make, must not leak in.
# Nor that modules are not kept compiled, or each of the hundreds of processes of the tests would compile them anew.
ifneq ($(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
unexport PYTHONDONTWRITEBYTECODE
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION

.PHONY: help env test tested test-long lint types colcon release-tree pytest demo bench certificate faults soak hidden-effects paper calibration closed-loop fleet workbench fuzz site docs clean distclean FORCE

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-14s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

# --- environment ------------------------------------------------------------------------------------------
# Each step leaves a stamp when it has succeeded. The first holds where the environment was made and with
# which Python, so that a copied folder or another PYTHON makes a new one.

env: $(STAMPS)/complete ## .venv with everything, the messages and the project (PYTHON=..., VENV=...)

VERSION_OF = $(shell "$(1)" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
BUILT := $(shell cat "$(STAMPS)/python" 2>/dev/null)
ifneq ($(firstword $(BUILT)),$(abspath $(VENV)))
$(STAMPS)/python: FORCE
else ifneq ($(origin PYTHON),file)
ifneq ($(lastword $(BUILT)),$(call VERSION_OF,$(PYTHON)))
$(STAMPS)/python: FORCE
endif
endif

$(STAMPS)/python:
	@tools/check_machine.sh "$(PYTHON)"
	@echo "make env: new environment $(VENV) with $$("$(PYTHON)" --version)"
	@rm -rf "$(VENV)"
	@"$(PYTHON)" -m venv "$(VENV)"
	@mkdir "$(STAMPS)"
	@echo "$(abspath $(VENV)) $(call VERSION_OF,$(PYTHON))" >$@

$(STAMPS)/packages: setup.py constraints.txt $(STAMPS)/python
	@rm -f $(STAMPS)/complete
	@echo "make env: installing packages, half a minute"
	@$(PIP) install --upgrade pip 'setuptools>=70.1,<80' wheel
	@$(PIP) install --no-compile --no-build-isolation -c constraints.txt -e '.[all]'
	@touch $@

MESSAGES := msg_defs/CMakeLists.txt msg_defs/package.xml $(wildcard msg_defs/msg msg_defs/srv msg_defs/*/*) tools/build_messages.sh

$(STAMPS)/messages: $(MESSAGES) $(STAMPS)/packages
	@echo "make env: building aircraft_sysid_msgs"
	@tools/build_messages.sh "$(VENV)" build/messages
	@touch $@

KERNELS := $(shell grep -rl --include='*.py' njit aircraft_sysid_ros)

$(STAMPS)/kernels: $(KERNELS) $(STAMPS)/packages
	@echo "make env: compiling the numerical kernels, a minute or two"
	@find aircraft_sysid_ros examples test -name '*.nb[ic]' -delete
	@$(BIN)/python -m aircraft_sysid_ros.compile_kernels
	@touch $@

$(STAMPS)/complete: $(MESSAGES) $(KERNELS) $(STAMPS)/packages
	@$(MAKE) --no-print-directory -j2 $(STAMPS)/messages $(STAMPS)/kernels
	@touch $@

# --- checks -----------------------------------------------------------------------------------------------

test: env ## everything that a change must pass: lint, types, colcon build, tests
	@$(MAKE) --no-print-directory lint
	@$(MAKE) --no-print-directory -j2 -Otarget types tested || { $(BIN)/mypy --no-error-summary || true; exit 1; }

# One test uses the workspace. mypy goes on beside them, in the time that they wait; what it found stands at the end too.
tested: colcon
	@$(MAKE) --no-print-directory -Onone pytest

lint: env ## ruff, its format, and the layers of .importlinter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check -q .
	$(BIN)/lint-imports

types: env ## mypy
	nice $(BIN)/mypy

# Tests take ROS domains of their own, see test/conftest.py, and hear nothing else on the network. One worker more than
# cores: two of them run tests with nodes at first, which wait for half of their time.
pytest: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
pytest: export ROS_LOG_DIR := $(abspath build/ros_log)
pytest: env ## the tests alone; ARGS='-k name -x' selects
	$(BIN)/python -m pytest -n $$(($$(nproc) + 1)) $(ARGS)

test-long: ## the tests that `make test` leaves out, more than an hour: further ways and flights, many seeds
	@$(MAKE) --no-print-directory pytest ARGS="-m long $(ARGS)"

# What is built is what is released: the tree of `make release-tree`, in a workspace, without options.
COLCON_WS := build/colcon
COLCON_SOURCES = $(shell find aircraft_sysid_ros msg_defs resource config launch setup.py setup.cfg pyproject.toml package.xml MANIFEST.in tools/release_tree.sh -type f -not -path '*/__pycache__/*')
NODES := $(COLCON_WS)/install/aircraft_sysid_ros/lib/aircraft_sysid_ros

colcon: env $(COLCON_WS)/complete ## both packages in a workspace, as on an ordinary ROS 2

$(COLCON_WS)/complete: $(COLCON_SOURCES) $(STAMPS)/messages
	@if [ ! $@ -nt $(STAMPS)/messages ]; then rm -rf $(COLCON_WS); fi
	@rm -rf $(COLCON_WS)/src $(COLCON_WS)/*/aircraft_sysid_ros
	tools/release_tree.sh $(BIN)/python $(COLCON_WS)/src
	cd $(COLCON_WS) && PATH="$(abspath $(BIN)):$$PATH" VIRTUAL_ENV="$(abspath $(VENV))" CMAKE_GENERATOR=Ninja \
	    AMENT_PREFIX_PATH="$(abspath $(VENV))" CMAKE_PREFIX_PATH="$(abspath $(VENV))" colcon build
	test -x $(NODES)/state_estimator -a -x $(NODES)/parameter_estimator -a -x $(NODES)/mavlink_bridge -a -x $(NODES)/px4_bridge -a -x $(NODES)/overview -a -x $(NODES)/aircraft-sysid
	touch $@

release-tree: ## both packages side by side in DIR=..., for a workspace, rosdep and bloom
	@test -n "$(DIR)" || { echo "make release-tree: say where: make release-tree DIR=../ws/src" >&2; exit 1; }
	@tools/release_tree.sh "$(if $(wildcard $(BIN)/python),$(BIN)/python,$(PYTHON))" "$(DIR)"

# --- use --------------------------------------------------------------------------------------------------

demo: env ## a simulated flight from recording to report
	$(BIN)/aircraft-sysid demo

workbench: env ## the page of the demo's run, on this machine
	@test -f runs/demo/run/samples.npz || $(BIN)/aircraft-sysid demo
	$(BIN)/aircraft-sysid workbench runs/demo/run --truth runs/demo/flight

bench: env ## accuracy, speed and real flights: results, tables and pictures in docs/
	@$(BIN)/python -c 'import filterpy, statsmodels' 2>/dev/null || \
	    $(PIP) install --no-build-isolation -c constraints.txt -e '.[bench]'
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/kernel_speed.py
	$(BIN)/python benchmarks/replay_speed.py
	$(BIN)/python benchmarks/live_load.py
	$(BIN)/python benchmarks/recursive_likelihood.py
	@if [ -d ../shared/data ]; then $(BIN)/python benchmarks/real_flights.py; else echo "real flights are not here: left as they are"; fi
	@$(MAKE) --no-print-directory docs

certificate: env ## coverage, bias and times of all estimators over 200 flights; goes on where it was stopped (hours)
	$(BIN)/python benchmarks/certificate_cells.py --each 100
	$(BIN)/python benchmarks/certificate.py
	@$(MAKE) --no-print-directory docs

faults: env ## ten thousand flights on which something fails: what is held, how soon, and what is wrong in USE; goes on where it was stopped
	$(BIN)/python benchmarks/faults.py

soak: env ## a day of flight, accelerated: the memory of the process, and what a second of flight takes (HOURS=24)
	$(BIN)/python benchmarks/soak.py --hours $(or $(HOURS),24)

hidden-effects: env ## does the diagnosis name what is missing: hidden effects and clean flights; goes on where it was stopped (hours)
	@$(BIN)/python -c 'import pysindy, sklearn' 2>/dev/null || \
	    $(PIP) install --no-build-isolation -c constraints.txt -e '.[bench]'
	$(BIN)/python benchmarks/hidden_effects.py --set tuned
	$(BIN)/python benchmarks/hidden_effects.py --set fresh
	$(BIN)/python benchmarks/further_effects.py
	@$(MAKE) --no-print-directory docs

paper: env ## tables 1 to 4 and figures 2 and 4 of the two-stage paper, ours beside the published numbers (minutes)
	$(BIN)/python benchmarks/paper.py
	@$(MAKE) --no-print-directory docs

calibration: env ## calibrations against 100 truths and on a real probe; goes on where it was stopped (an hour or two)
	$(BIN)/python benchmarks/calibration.py
	$(BIN)/python benchmarks/two_stage_speed.py
	$(BIN)/python benchmarks/probe_models.py
	$(BIN)/python benchmarks/filter_start.py
	@$(MAKE) --no-print-directory docs

closed-loop: env ## a controller on live parameters against fixed and true ones, damage and sensor faults; goes on where it was stopped (an hour)
	$(BIN)/python benchmarks/closed_loop.py
	@$(MAKE) --no-print-directory docs

fuzz: env ## random and nearly right input against all that reads what others write (MINUTES=10, TARGETS='mcap runs')
	$(BIN)/python test/fuzz/long.py --minutes $(or $(MINUTES),10) $(TARGETS)

fleet: env ## 400 simulated flights of 8 airframes with stated truth; goes on where it was stopped (many hours)
	$(BIN)/python benchmarks/fleet_changes.py
	$(BIN)/python benchmarks/fleet_prior.py
	$(BIN)/python benchmarks/fleet_health.py
	$(BIN)/python benchmarks/fleet.py
	$(BIN)/python benchmarks/fleet_killed.py
	$(BIN)/python benchmarks/fleet.py --small
	$(BIN)/python benchmarks/fleet.py --small --costs 4
	$(BIN)/python benchmarks/fleet_constants.py
	@$(MAKE) --no-print-directory docs

site: env ## the documentation as a site in build/site; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "build/site/index.html"

docs: env ## tables and pictures of README and docs/ from the results
	$(BIN)/python docs/build.py

clean: ## build products; the environment stays
	rm -rf build install log dist ./*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +

distclean: clean ## the environment too
	rm -rf "$(VENV)"
