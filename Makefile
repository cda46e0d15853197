# Runs what is missing or stale of one experiment: make EXPERIMENT=x. `make help` lists what else there is.
EXPERIMENT ?= demo
CONFIG ?= configs/$(EXPERIMENT).yaml
RUNS ?= runs
PYTHON ?= python3
VENV ?= .venv
# The address of PyTorch's CPU wheels, where the default index has only the builds for CUDA (gigabytes).
TORCH_INDEX ?=

RUN := $(RUNS)/$(EXPERIMENT)
# All that testing and documenting need, and what making a model needs, which is a part of it.
ENVIRONMENT := $(VENV)/.installed
comma := ,
USED := $(firstword $(wildcard $(ENVIRONMENT)) $(VENV)/.used)
LDSIM := $(VENV)/bin/ldsim

# The paper's meshes and recordings, where nobody said otherwise and they lie beside the project.
ifndef LDSIM_DATA
ifneq ($(wildcard ../shared/data),)
export LDSIM_DATA := $(abspath ../shared/data)
endif
endif

# The examples that have run to their end, whose live pages the site has.
FINISHED = $(patsubst $(RUNS)/%/report/report.json,%,$(wildcard $(patsubst configs/%.yaml,$(RUNS)/%/report/report.json,$(wildcard configs/*.yaml))))

STAGES := mesh snapshot pca train cubature simulate report

.DEFAULT_GOAL := report
# One thing at a time even under -j: the stages share out the cores themselves, and simulate is timed.
.NOTPARALLEL:
# What `make paper` makes: all, or fig9, and QUICK=yes for small versions.
NAME ?= all
QUICK ?=

.PHONY: $(STAGES) demo paper settings test bounds lint examples pictures site clean help

# What is missing or stale `ldsim make` knows, which also works without make. The + asks it under `make -n` too.
$(STAGES): $(USED)
	$(if $(wildcard $(firstword $(LDSIM))),+)@$(LDSIM) make $(CONFIG) --experiment $(EXPERIMENT) --runs $(RUNS) \
	    --until $@ $(if $(findstring n,$(firstword -$(MAKEFLAGS))),--dry-run)

mesh: ## stage 1: read or make the mesh and write the scene
snapshot: ## stage 2: run the motions in the full space
pca: ## stage 3: find the linear basis
train: ## stage 4: train the latent space
cubature: ## stage 5: choose the cubature points
simulate: ## stage 6: run the motions in the reduced spaces and compare
report: ## stage 7 and the default: write the report

$(ENVIRONMENT) $(VENV)/.used: pyproject.toml requirements.lock
	$(PYTHON) -m venv $(VENV)
# What is never imported need not be compiled.
	@echo "installing the packages of requirements.lock into $(VENV), about 1.4 GB"
	$(VENV)/bin/python -m pip install --no-compile $(if $(TORCH_INDEX),--no-deps --index-url $(TORCH_INDEX)) \
	    $(shell grep ^torch== requirements.lock)
	$(VENV)/bin/python -m pip install --no-compile --constraint requirements.lock \
	    --editable '.[$(if $(findstring $(ENVIRONMENT),$@),dev,train$(comma)surface)]'
	@touch $@

demo: ## the embedded demo through all stages
	@$(MAKE) --no-print-directory EXPERIMENT=demo report

paper: $(ENVIRONMENT) ## the paper's tables and figures: NAME=all or fig9, QUICK=yes for small ones
	$(VENV)/bin/python -m reproduction.paper.command $(NAME) --runs $(RUNS) $(if $(QUICK),--quick)

settings: $(USED) ## check the configuration and print it with defaults
	@$(LDSIM) settings $(CONFIG)

test: $(ENVIRONMENT) ## all tests
	$(VENV)/bin/python -m pytest --numprocesses auto --maxprocesses 4 --max-worker-restart 0

bounds: $(ENVIRONMENT) ## tests of what is compiled, every index checked; minutes to compile anew
	NUMBA_BOUNDSCHECK=1 $(VENV)/bin/python -m pytest tests/optimise tests/mechanics tests/space tests/cubature \
	    tests/dynamics tests/simulator tests/faults

lint: $(ENVIRONMENT) ## style and types
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

examples: $(ENVIRONMENT) ## every example of configs/ to its report and its live page: an hour, with LDSIM_DATA hours
	$(VENV)/bin/python -m reproduction.bench.examples --runs $(RUNS)
	$(VENV)/bin/python docs/generate.py

pictures: $(ENVIRONMENT) ## every picture of README and the guide but one (reproduction/pictures.py); needs chromium
	@$(MAKE) --no-print-directory EXPERIMENT=demo report
	@$(MAKE) --no-print-directory EXPERIMENT=ci report
	$(VENV)/bin/python -m reproduction.pictures --runs $(RUNS)
	$(VENV)/bin/python docs/generate.py

site: $(ENVIRONMENT) ## the documentation as a site with search and live pages of the finished runs, in build/site
	@$(foreach run,$(FINISHED),$(LDSIM) export $(RUNS)/$(run) --playground &&) true
	$(VENV)/bin/python -m mkdocs build --strict

# Without a name it would be the folder of all runs.
clean: ## remove the files of the experiment
	$(foreach name,EXPERIMENT RUNS,$(if $(strip $($(name))),,$(error $(name) is empty; what would be removed is $(RUN))))rm -rf $(RUN) $(basename $(CONFIG)).enriched$(suffix $(CONFIG))

help: ## this list
	@echo "make [GOAL] [EXPERIMENT=$(EXPERIMENT)]: EXPERIMENT names a file in configs/, its files lie in runs/EXPERIMENT/"
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  \1\t\2/p' Makefile | expand -t 14
