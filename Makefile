# What one does with a checkout of jgait. `make` alone lists it; .ci/setup makes the environment.

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

BIN := .venv/bin
STAMP := .venv/ready
BENCH_STAMP := .venv-bench/ready
# The demonstration needs a third of the packages: it has an environment of its own, unless the whole one is there.
DEMO_STAMP := $(if $(wildcard $(STAMP)),$(STAMP),.venv-demo/ready)
JOBS ?= 2
ARGS ?=

# A stamp holds the folder that the environment was made in: a checkout that was moved sets up anew, and so does
# one whose Python has gone.
ifneq ($(shell test -x $(BIN)/python && cat $(STAMP) 2>/dev/null),$(CURDIR))
.PHONY: $(STAMP)
endif
ifneq ($(shell test -x .venv-demo/bin/python && cat .venv-demo/ready 2>/dev/null),$(CURDIR))
.PHONY: .venv-demo/ready
endif
ifneq ($(shell test -x .venv-bench/bin/python && cat $(BENCH_STAMP) 2>/dev/null),$(CURDIR))
.PHONY: $(BENCH_STAMP)
endif

# Libraries that need other versions than jgait: experiments/common/peers/NAME.txt becomes .venv-NAME.
PEERS := $(basename $(notdir $(wildcard experiments/common/peers/*.txt)))
.PHONY: $(patsubst %,.venv-%/ready,$(shell for peer in $(PEERS); do \
	test -x .venv-$$peer/bin/python && test "$$(cat .venv-$$peer/ready 2>/dev/null)" = "$(CURDIR)" || echo $$peer; done))

# Recordings that lie beside the checkout are used without being told.
ifeq ($(origin JGAIT_DATA_DIR),undefined)
BESIDE := $(shell cd ../shared/data 2>/dev/null && pwd)
ifneq ($(BESIDE),)
export JGAIT_DATA_DIR := $(BESIDE)
endif
endif

# Which experiments or benchmarks run; all of them if it is empty.
NAMES ?=

NOTEBOOKS ?= $(wildcard notebooks/*.ipynb)

.PHONY: help setup demo test release lint types docs experiments presets summary bench peers lock supply clean

help: ## list the targets
	@echo "make TARGET, one of:"
	@sed -n 's/^\([a-z]*\):[^#]*## \(.*\)/  \1|\2/p' Makefile | awk -F'|' '{ printf "%-14s %s\n", $$1, $$2 }'
	@echo "Python >= 3.12 is found by itself; another one: make TARGET PYTHON=/path/to/python"

setup: $(STAMP) ## make the environment in .venv (the other targets do it by themselves)

$(STAMP): pyproject.toml requirements.lock .ci/setup
	@PYTHON="$(PYTHON)" sh .ci/setup

demo: $(DEMO_STAMP) ## tuning and judging on simulated people, a real walk by one call if it is here; ARGS="--help" says more
	@$(dir $(DEMO_STAMP))bin/python -m jgait.cli demo $(ARGS)

.venv-demo/ready: pyproject.toml requirements-demo.lock .ci/setup
	@PYTHON="$(PYTHON)" sh .ci/setup demo

test: lint types ## lint, check the types, run the tests; ARGS="-k leg" for some of the tests
	@$(BIN)/python -m pytest -n $(JOBS) -m "not release" $(ARGS)

release: $(STAMP) ## run the tests that take minutes: packages, the site, notebooks, the guide, experiments, large programs
	@$(BIN)/python -m pytest -n $(JOBS) -m release $(ARGS)

lint: $(STAMP) ## ruff: rules and format
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(STAMP) ## mypy
	@$(BIN)/mypy jgait

experiments: $(STAMP) ## run every experiment; results/NAME.json; NAMES="leg_ekf foot_ins" for some, ARGS="--quick" for a first look
	@mkdir -p results
	@for name in $(or $(NAMES),$$($(BIN)/python -m experiments --list experiments)); do \
		echo "experiments: $$name"; \
		$(BIN)/python -m experiments "$$name" --json "results/$$name.json" $(ARGS) || exit 1; \
	done

presets: $(STAMP) ## tune the foot again; write a preset if it is better on days left out
	@$(BIN)/python -m experiments.autotune.preset

summary: $(STAMP) ## write the table of all experiments into experiments/README.md, its main lines into README.md
	@$(BIN)/python -m experiments.common.summary $(ARGS)

# Notebooks are run beside their sources, for what they write, and again only when they or the library have changed.
# One whose recordings are not on this computer is shown without outputs.
build/notebooks/%.ipynb: notebooks/%.ipynb $(shell find jgait -name '*.py') | $(STAMP)
	@mkdir -p $(@D)
	@cp $< $@
	@$(BIN)/jupyter-execute --inplace --timeout=1200 $@ 2> $@.log || \
		{ grep -m1 -o "data set '[a-z0-9_]*' is not there: .*" $@.log && \
			echo "  so the gallery's page $(basename $(@F)) shows code without outputs"; } || { cat $@.log >&2; exit 1; }

docs: $(STAMP) $(NOTEBOOKS:%=build/%) ## run the notebooks, write the documentation: build/site; NOTEBOOKS= runs none
	@$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --doctree-dir build/doctrees docs build/site $(ARGS)
	@echo "build/site/index.html"

$(BENCH_STAMP): pyproject.toml .ci/setup
	@PYTHON="$(PYTHON)" sh .ci/setup bench

bench: $(BENCH_STAMP) ## run the benchmarks against other libraries, in .venv-bench; results/NAME.json
	@mkdir -p results
	@for name in $(or $(NAMES),$$(.venv-bench/bin/python -m experiments --list benchmarks)); do \
		echo "experiments: $$name"; \
		.venv-bench/bin/python -m experiments "$$name" --json "results/$$name.json" $(ARGS) || exit 1; \
	done

PEER_STAMPS := $(PEERS:%=.venv-%/ready)
$(PEER_STAMPS): .venv-%/ready: experiments/common/peers/%.txt .ci/setup
	@PYTHON="$(PYTHON)" sh .ci/setup peer $*

peers: $(PEER_STAMPS) ## make the environments of the libraries that experiments compare with: .venv-NAME

lock: $(STAMP) ## write requirements.lock for a changed pyproject.toml; ARGS="--upgrade" for newer versions
	@sh .ci/lock $(ARGS)

supply: $(STAMP) ## list the locked packages in build/sbom.json, and look for known faults of them
	@sh .ci/supply

clean: ## remove the environments and caches (results stay)
	rm -rf .venv .venv-demo .venv-bench $(PEERS:%=.venv-%) .mypy_cache .pytest_cache .ruff_cache build dist
	find jgait tests experiments -name __pycache__ -type d -prune -exec rm -rf {} +
