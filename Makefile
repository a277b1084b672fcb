# make run       a six-legged robot walks in simulation for half a minute; its foot forces, live; a page in the browser
# make install   the same without the walk: `. .venv/bin/activate`, then footsense
# make test      format, lint, types, import contracts, and the fast tests: a change is good
# make test-all  the same with all tests: meshes, the page in a browser, packaging, studies, random faults
# make docs      the documentation site: build/site/docs/index.html
# make fuzz      an hour of other and more examples for the tests in tests/fuzz
# make lock      the newest packages for a robot: deploy/requirements.lock, with their hashes
# make mutants ROOM=footsense/can   changes the code of a room or module in small ways, and lists what no test notices
# make kernel-test         the service as deployed, on a Debian kernel in an emulator; needs Debian 12 and root
# make kernel-test-short   the first of these trials, as CI runs them after the tests; does nothing where it cannot
# All make their own .venv; only Python 3.11+, make and git are needed.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: run install test test-all check slow-tests docs kernel-test kernel-test-short fuzz lock mutants format golden clean

run: $(VENV)/robot.stamp
	$(BIN)/footsense run --realtime --duration 30

install: $(VENV)/robot.stamp

check: $(VENV)/dev.stamp
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: check
	$(BIN)/pytest -n auto --dist worksteal -m "not slow"

test-all: check
	$(BIN)/pytest -n auto --dist worksteal

# What test-all runs and test does not.
slow-tests: $(VENV)/dev.stamp
	$(BIN)/pytest -n auto --dist worksteal -m slow

# A link that leads nowhere, or a page that is in no table of contents, ends it.
docs: $(VENV)/robot.stamp
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --jobs auto -c docs/site . build/site
	@echo build/site/docs/index.html

kernel-test: $(VENV)/dev.stamp
	$(BIN)/python -m tests.kernel

kernel-test-short: $(VENV)/dev.stamp
	$(BIN)/python -m tests.kernel --short

fuzz: $(VENV)/dev.stamp
	$(BIN)/python -m tests.fuzz $(ARGS)

# One file for x86-64 and aarch64, of wheels alone: a source package would build itself with packages that have no hash
# here. That is also why footsense's own build requirements are among them.
lock: $(VENV)/robot.stamp
	$(BIN)/python -m pip install --quiet --group lock
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"])' \
	    | $(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --only-binary :all: \
	        --emit-build-options --generate-hashes --custom-compile-command 'make lock' \
	        --output-file deploy/requirements.lock pyproject.toml -

# ARGS="--sample 200" draws some of the changes; a whole room takes an hour.
mutants: $(VENV)/dev.stamp
	$(BIN)/python -m pip install --quiet --group mutants
	$(BIN)/python -m tests.mutants $(ROOM) $(ARGS)

format: $(VENV)/dev.stamp
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) dist build

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("footsense needs Python 3.11 or newer; try: make PYTHON=python3.11") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/robot.stamp: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

# --group reads the PEP 735 table of development tools, which is not part of the wheel.
$(VENV)/dev.stamp: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[lab]' --group dev
	@touch $@ $(VENV)/robot.stamp

# The recorded walk that every change is replayed against; to be made anew only by a change that is meant to change forces.
golden: $(VENV)/robot.stamp
	rm -f tests/golden/measured_walk.mcap
	$(BIN)/footsense run --scene measured_walk --duration 4 --record tests/golden/measured_walk.mcap --summary text
