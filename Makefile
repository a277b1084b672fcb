# make run       a six-legged robot walks in simulation for half a minute; its foot forces, live; a page in the browser
# make install   the same without the walk: `. .venv/bin/activate`, then footsense
# make help      this text
# make test      format, lint, types, import contracts, and the fast tests: a change is good
# make test-all  the same with all tests: meshes, the page in a browser, packaging, studies, the soak
# make docs      the reference pages anew from the code, and the documentation site: build/site/docs/index.html
# make release   both wheels and the sdist in dist/, installed in a clean environment, where the README's five lines run; tags nothing
# make fuzz      an hour of other and more examples for the tests in tests/fuzz
# make lock      renews the versions and hashes that all of these install: deploy/ and tests/requirements.lock
# make golden    the recorded walk anew that every change is replayed against; only for a change that is meant to change forces
# make instructions   counts the instructions of a cycle: none may take 5 % more than those committed; ARGS=--write renews these
# make kernel-test         the service as deployed, on a Debian kernel in an emulator; needs Debian 12 and root
# make kernel-test-short   the first of these trials, a part of CI's verdict; does nothing where it cannot
# make board           the converter board of deploy/board checked, and its files for a maker in build/board; needs KiCad 9, or Debian 12 and root
# make firmware     the firmware of a microcontroller that scans feet: built, tested on an emulated one, and its size
# make aarch64-test        the robot's packages, golden recordings, C client and ring on an emulated aarch64; the same
# NEWEST=1 behind any of them installs the newest packages in place of the locked ones, in .venv-newest.
# All make their own environment; only Python 3.11+, make and git are needed.

PYTHON ?= python3
VENV   := .venv$(if $(NEWEST),-newest)
BIN    := $(VENV)/bin
# Of the index that pip is set to, as uv does not read that.
INDEX  := url=$${UV_DEFAULT_INDEX:-$$($(BIN)/pip config list | sed -n "s/.*\.index-url='\(.*\)'/\1/p" | tail -n 1)}; \
	env $${url:+UV_DEFAULT_INDEX=$$url}
UV     := $(INDEX) $(BIN)/uv pip
SYNC   := $(UV) install --quiet --python $(BIN)/python

# Hundreds of processes load the same modules, which are compiled once.
unexport PYTHONDONTWRITEBYTECODE

# What is done is said by `echo`, not by the recipes' text.
.SILENT:
.PHONY: run help install test test-all check slow-tests docs release kernel-test kernel-test-short instructions aarch64-test board firmware fuzz lock format golden clean newest

run: $(VENV)/robot.stamp
	$(BIN)/footsense run --realtime --duration 30

# The lines above.
help:
	sed -n '/^#/!q; s/^# //p' $(firstword $(MAKEFILE_LIST))

install: $(VENV)/robot.stamp
	echo "installed; next: . $(BIN)/activate, then footsense run"

test: check
	echo "the fast tests"
	$(BIN)/pytest -n auto --dist worksteal -m "not slow"

test-all: check
	echo "all tests"
	$(BIN)/pytest -n auto --dist worksteal

# What test-all runs and test does not.
slow-tests: $(VENV)/dev.stamp
	$(BIN)/pytest -n auto --dist worksteal -m slow

check: $(VENV)/dev.stamp
	echo "format, lint, types, import contracts"
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# A link that leads nowhere, or a page that is in no table of contents, ends it.
docs: $(VENV)/dev.stamp
	echo "the reference pages and those of the report, then the site"
	$(BIN)/footsense lab report --text
	$(BIN)/python docs/site/reference.py
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --jobs auto -c docs/site . build/site
	echo build/site/docs/index.html

release: $(VENV)/dev.stamp
	$(BIN)/python -m tests.packaging.release

kernel-test: $(VENV)/dev.stamp
	$(BIN)/python -m tests.kernel

kernel-test-short: $(VENV)/dev.stamp
	$(BIN)/python -m tests.kernel --short

instructions: $(VENV)/dev.stamp
	$(BIN)/python -m tests.golden.instructions $(ARGS)

firmware: $(VENV)/dev.stamp
	$(BIN)/python -m tests.firmware

aarch64-test: $(VENV)/dev.stamp
	$(INDEX) $(BIN)/python -m tests.aarch64

board: $(VENV)/dev.stamp
	$(BIN)/python -m tests.board $(ARGS)

fuzz: $(VENV)/dev.stamp
	$(BIN)/python -m tests.fuzz $(ARGS)

format: $(VENV)/dev.stamp
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

golden: $(VENV)/robot.stamp
	rm -f tests/golden/*.mcap
	$(BIN)/footsense run --scene measured_walk --duration 4 --record tests/golden/measured_walk.mcap --summary text
	$(BIN)/footsense run --config tests/golden/small.yaml --scene measured_walk --duration 2 \
	    --record tests/golden/small_board.mcap --summary text

clean:
	rm -rf .venv .venv-newest dist build

# ---------------------------------------------------------------- environments
$(BIN)/python:
	echo "the first time: making $(VENV), a minute or two"
	$(PYTHON) -c 'import sys; sys.exit("footsense needs Python 3.11 or newer; try: make PYTHON=python3.11") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)

# uv by its own entry of the lock; it installs all else.
$(BIN)/uv: tests/requirements.lock $(BIN)/python
	sed -n '/^uv==/,/[^\\]$$/p' $< >$(VENV)/uv.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $(VENV)/uv.txt
	touch $@

ifdef NEWEST
# On each call, as an index may have something newer each time. The group is a table of pyproject.toml, not part of the wheel.
$(VENV)/robot.stamp: $(BIN)/uv newest
	$(SYNC) --upgrade --editable .
	touch $@

$(VENV)/dev.stamp: $(BIN)/uv newest
	$(SYNC) --upgrade --editable '.[lab]' --group dev
	touch $@
else
# The project itself, without a look at any index: what builds it is in both locks.
EDITABLE := $(SYNC) --offline --no-deps --no-build-isolation --editable deploy/client --editable .

$(VENV)/robot.stamp: deploy/requirements.lock pyproject.toml deploy/client/pyproject.toml $(BIN)/uv
	echo "installing footsense and the packages of $<"
	$(SYNC) --require-hashes -r $<
	$(EDITABLE)
	touch $@

$(VENV)/dev.stamp: tests/requirements.lock pyproject.toml deploy/client/pyproject.toml $(BIN)/uv
	echo "installing footsense and the packages of $<"
	$(SYNC) --require-hashes -r $<
	$(EDITABLE)
	touch $@ $(VENV)/robot.stamp
endif

# Of wheels alone: a source package would build itself with packages that have no hash here. The second has the versions of
# the first, and all that the targets above use. Each kind of computer has to find a wheel of every package.
LOCK := $(UV) compile --quiet --upgrade --universal --python-version 3.11 --only-binary :all: --emit-build-options \
	--generate-hashes --no-emit-package footsense-client --custom-compile-command 'make lock'

lock: $(BIN)/uv
	$(LOCK) --output-file deploy/requirements.lock --group build pyproject.toml
	$(LOCK) --output-file tests/requirements.lock --constraint deploy/requirements.lock --extra lab --group dev pyproject.toml
	for machine in x86_64 aarch64; do for version in 3.11 3.12 3.13; do for lock in deploy tests; do \
	    $(SYNC) --dry-run --require-hashes --target $(VENV)/none --python-platform $$machine-manylinux_2_28 \
	        --python-version $$version -r $$lock/requirements.lock || exit 1; \
	done; done; done
