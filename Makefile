# Every target builds what it needs in .venv; nothing has to be installed first but Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/installed
export SINS_ENV_DATA ?= $(abspath ../shared/data)
# one BLAS thread per process: the batches are small, and processes use the cores
export OPENBLAS_NUM_THREADS ?= 1
# every process reads compiled files: the tests start many
unexport PYTHONDONTWRITEBYTECODE
N ?= 10000
GALLERY ?= 1
TESTS ?= tests

.PHONY: board test check lint types tests docs fuzz bench reproduce leaderboard coverage distribution clean

board: $(STAMP)  ## four filters align a swaying SINS: ranked table and figure
	$(BIN)/sins-env eval --task sway-white-v0 --solver kf ekf ukf ckf --runs 200 --db results.sqlite --resume --plot board.png

test: $(STAMP)  ## every test
	$(BIN)/python -m pytest -n 3 --dist worksteal $(TESTS)  # one more than cores, for some tests wait

check: lint types tests  ## what CI runs: ruff, mypy, tests (examples and README blocks are among them)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

tests: test

docs: $(VENV)/docs  ## the site, build/site/index.html, with the gallery run; GALLERY=0 shows the examples and does not run them
	rm -rf build/site build/doctrees
	$(BIN)/sphinx-build -W --keep-going -q -c docs -d build/doctrees -D plot_gallery=$(GALLERY) . build/site

fuzz: $(STAMP)  ## N inputs of strangers, of all kinds, on all cores: a table, and the inputs that fail as code
	PYTHONPATH=tests $(BIN)/python -m fuzz $(N)

bench: $(STAMP)  ## speed of the whole chain, and of the filters beside those of other packages (in .venv-peers)
	$(BIN)/sins-env bench
	$(BIN)/python benchmarks/peers.py

reproduce: $(STAMP)  ## every published table again: reproduction/REPRODUCTION.md and its figures, in less than an hour on two cores
	$(BIN)/sins-env reproduce

leaderboard: $(STAMP)  ## tables and figures of docs; hours from nothing, what leaderboard.sqlite holds is kept
	$(BIN)/python benchmarks/leaderboard.py
	$(BIN)/python benchmarks/pages.py
	$(BIN)/python benchmarks/peers.py --doc

coverage: $(STAMP)  ## lines and branches that the tests reach, processes too; kernels where tests run their bodies: twenty minutes
	$(BIN)/python -m pip install --quiet --group coverage
	$(BIN)/coverage run -m pytest -n 3 --dist worksteal $(TESTS)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

distribution: $(STAMP)  ## sdist and wheel in dist/; the sdist is unpacked, installed in a fresh environment, and tests itself
	rm -rf dist build/sdist
	$(BIN)/python -m pip install --quiet --group release
	$(BIN)/python -m build --quiet
	$(BIN)/twine check --strict dist/*
	mkdir -p build/sdist
	tar -xf dist/*.tar.gz -C build/sdist --strip-components 1
	$(MAKE) -C build/sdist test

$(STAMP): pyproject.toml
	@echo "Building $(VENV) and installing into it: a minute or more, once."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable ".[dev]"
	@echo "Compiling the kernels: half a minute, once."
	$(BIN)/sins-env warm
	touch $@

$(VENV)/docs: $(STAMP)
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) .venv-peers build dist *.egg-info .coverage* .pytest_cache .mypy_cache .ruff_cache results.sqlite* board.png docs/gallery docs/api/*.rst
