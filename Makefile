# Thin: each target is one or two commands that also work without make, in the environment.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORES ?= all
FUZZ_SECONDS ?= 600
TESTS ?= tests/models tests/files
FIRST := tests/config tests/files tests/supply_chain tests/signals
LONGEST := tests/workflow tests/packaging tests/fletcher_powell tests/estimation tests/pipeline
# Tests of the workflow wait for processes, so one more than there are cores: with two more the
# whole took no less time.
WORKERS := $(shell echo $$(($$(nproc 2>/dev/null || echo 1) + 1)))
EXTRAS := --extra workflow --extra slurm --extra control
UPGRADE ?=
# A fifth of what is installed is imported: that is compiled then, by jobs beside each other.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile --require-hashes -r
# What a search needs, and all else, which is installed while its kernels are compiled; the lock file is
# complete.  By uv in a third of pip's time; by pip where uv fails, as it may behind an index that pip alone knows.
SEARCH := annotated-types|llvmlite|numba|numpy|pydantic|pydantic-core|pyyaml|scipy|threadpoolctl|typing-.*
LOCKED = awk '/^[a-z]/ {chosen = /^($(1))==/} $(2)chosen'
UV := $(BIN)/uv pip install --quiet --python $(BIN)/python --require-hashes --no-deps -r -
HALF = $(call LOCKED,$(SEARCH),$(1)) requirements.lock | $(UV) || \
	$(call LOCKED,$(SEARCH),$(1)) requirements.lock | $(INSTALL) /dev/stdin --no-deps
# Two short searches, whose kernels the jobs of the first run would each compile.
KERNELS := from numpy.random import default_rng; from evopem import SearchSettings, estimate; \
	u, y = default_rng(1).standard_normal((2, 300)); \
	settings = SearchSettings(mu=4, lambda_=4, nu=4, evaluations=1); \
	estimate(u, y, (2, 2, 2, 1), settings=settings); estimate(u, y, 2, structure="ss", settings=settings)
# Without stored code each process of the tests would compile all of it.
unexport PYTHONDONTWRITEBYTECODE
COMPILE := $(BIN)/uv pip compile pyproject.toml $(EXTRAS) --universal --python-version 3.11 \
	--generate-hashes --no-emit-index-url --no-emit-find-links --no-header --quiet

.PHONY: report test matrix quick test-slurm lint format docs keys lock audit fuzz bench screenshots clean install-search install-rest
.DEFAULT_GOAL := report

report: $(VENV)/installed  ## run config.yaml from data to report
	$(BIN)/snakemake --cores $(CORES)
	@echo "Reports:"; ls -1 "$(CURDIR)"/results/*/report.html

test: $(VENV)/installed-dev  ## run every test, and the examples of the docstrings
	# First what compiles the kernels, and beside it what needs none.  Then the longest files, so that
	# no process is left alone with one at the end.  A folder that holds another one would bring both
	# into the order of their names.
	$(BIN)/pytest --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder tests/test_examples.py $(FIRST) \
		$(LONGEST) $(filter-out $(FIRST) $(LONGEST) tests/__pycache__,$(patsubst %/,%,$(wildcard tests/*/))) tests/test_smoke.py

matrix: $(VENV)/installed-dev  ## estimate every structure with every focus, objective and constraint
	EVOPEM_FULL_MATRIX=1 $(BIN)/pytest --quiet --numprocesses auto tests/estimation/test_matrix.py tests/terminal/test_matrix.py

quick: $(VENV)/installed-dev  ## what an edit needs in half a minute: style, types, a plan, and TESTS
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	# Types beside the tests: without stored results they take as long.
	$(BIN)/mypy & types=$$!; \
		$(BIN)/pytest --quiet --exitfirst --numprocesses auto tests/test_smoke.py $(TESTS); tests=$$?; \
		wait $$types && exit $$tests

test-slurm: $(VENV)/installed-dev  ## run the tests on SLURM, started for them where that can be done
	EVOPEM_TEST_SLURM=1 PATH="$(CURDIR)/$(BIN):$$PATH" tests/workflow/with_slurm.sh $(BIN)/pytest tests/workflow/test_slurm.py

lint: $(VENV)/installed-dev  ## check style, types and the workflow
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/snakefmt --check Snakefile workflow/Snakefile workflow/rules benchmarks/fletcher_powell/Snakefile benchmarks/fletcher_powell/common.smk
	$(BIN)/mypy
	$(BIN)/snakemake --lint

format: $(VENV)/installed-dev  ## bring every file into the style
	$(BIN)/ruff check --fix
	$(BIN)/ruff format
	$(BIN)/snakefmt Snakefile workflow/Snakefile workflow/rules benchmarks/fletcher_powell/Snakefile benchmarks/fletcher_powell/common.smk

docs: docs/gallery/index.txt $(VENV)/installed-docs  ## build the documentation site into site/; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

docs/gallery/index.txt: $(shell git ls-files workflow examples docs/*.py 2>/dev/null) $(VENV)/installed-docs
	PYTHONPATH=workflow/scripts $(BIN)/python docs/make_gallery.py

keys: $(VENV)/installed-dev  ## write the schema for editors and the tables of docs/configuration.md
	$(BIN)/python docs/write_keys.py

lock: $(VENV)/installed-dev  ## bring the lock files in line with pyproject.toml; UPGRADE=--upgrade takes the newest versions
	$(COMPILE) $(UPGRADE) --output-file requirements.lock
	$(COMPILE) benchmarks/fletcher_powell/requirements.txt $(UPGRADE) --group dev --constraint requirements.lock --output-file requirements-dev.lock
	$(COMPILE) $(UPGRADE) --group docs --constraint requirements-dev.lock --output-file requirements-docs.lock

audit: $(VENV)/installed-dev  ## ask the advisory database about every pinned version (online)
	$(BIN)/uv tool run pip-audit --disable-pip --require-hashes --requirement requirements.lock

fuzz: $(VENV)/installed-dev  ## fuzz the readers for FUZZ_SECONDS, guided by coverage
	$(BIN)/uv pip install --quiet --python $(BIN)/python --group fuzz
	$(BIN)/python tests/fuzz/readers.py $(VENV)/fuzz-corpus -max_total_time=$(FUZZ_SECONDS)

bench: $(VENV)/installed-dev  ## compare the estimator's speed with others', in one run
	$(BIN)/uv pip install --quiet --python $(BIN)/python --group bench
	$(BIN)/python benchmarks/speed.py

screenshots: docs/gallery/index.txt  ## take the README's picture of a report
	$(BIN)/python docs/take_screenshots.py

clean:  ## remove the environment; results stay
	rm -rf $(VENV)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "evopem needs Python 3.11 or newer; try: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "Python's venv module is needed (Debian, Ubuntu: apt install python3-venv)"; exit 1; }

$(VENV)/installed: requirements.lock $(BIN)/python
	@echo "Installing requirements.lock into $(VENV)"
	@$(call LOCKED,uv) requirements-dev.lock | $(INSTALL) /dev/stdin --no-deps || true
	@$(MAKE) --no-print-directory --jobs 2 install-search install-rest
	@touch $@

install-search:
	@$(call HALF)
	@PYTHONPATH=workflow/scripts $(BIN)/python -c '$(KERNELS)'

install-rest:
	@$(call HALF,!)

$(VENV)/installed-dev: requirements-dev.lock $(VENV)/installed
	$(INSTALL) requirements-dev.lock
	@touch $@

$(VENV)/installed-docs: requirements-docs.lock $(VENV)/installed-dev
	$(INSTALL) requirements-docs.lock
	@touch $@
