# Everything runs in .venv, which is made by itself; `make help` lists the targets.

ROOT := $(CURDIR)
# mrcal's gnuplot is found only when the environment's bin stands first on PATH
RUN = PATH="$(ROOT)/.venv/bin:$$PATH"
PYTEST_FLAGS ?= -n 2

.DEFAULT_GOAL := help
.PHONY: help demo test lint format bench docs constraints clean

help:  ## list the targets
	@sed -n 's/^\([a-z][a-z]*\):.*##  */\1\t/p' Makefile | expand -t 14

.venv/.ready: pyproject.toml constraints.txt .python-version .ci/environment
	@.ci/environment
	@touch $@

demo: .venv/.ready  ## simulate the thesis rig, calibrate it, verify it, write demo/
	@$(RUN) fringecal demo --out demo

test: lint  ## lint, then every test and doctest (PYTEST_FLAGS="-n 0 -k name" to choose)
	@$(RUN) pytest $(PYTEST_FLAGS)

lint: .venv/.ready  ## ruff, its formatter and mypy, changing nothing
	@$(RUN) ruff check .
	@$(RUN) ruff format --check .
	@$(RUN) mypy

format: .venv/.ready  ## mend what ruff can mend
	@$(RUN) ruff check --fix .
	@$(RUN) ruff format .

bench: .venv/.ready  ## run every benchmark and print its figures
	@for script in benchmarks/*.py; do \
	    [ -e "$$script" ] || continue; \
	    echo "== $$script"; $(RUN) python "$$script" || exit 1; \
	done

.venv/.docs: .venv/.ready
	@.ci/environment docs
	@touch $@

docs: .venv/.docs  ## build the documentation as a site, warnings as errors, into site/
	@$(RUN) python docs/stage.py
	@$(RUN) NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet
	@echo "site/index.html"

constraints: .venv/.ready  ## resolve pyproject.toml anew and rewrite constraints.txt
	@.ci/constraints

clean:  ## remove what the other targets made
	rm -rf .venv .tools demo build dist site .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
