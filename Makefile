# Two commands do everything: `make demo` and `make test`. They need Python 3.11+ with venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_EPISODES ?= 64
DEMO_DIR ?= runs/demo
WORKERS ?= 2

.PHONY: demo bench test test-lowest test-slow lint check validate paper-docs sensitivity-docs studies-docs errors-docs models pictures figures docs notebook docs-commands lock clean

demo: $(VENV)/.installed  ## environment, install, the demo sweep, its leaderboard
	$(BIN)/warpgrasp sweep sweeps/studies/demo.toml -o $(DEMO_DIR) --workers $(WORKERS) \
		--set episodes_per_cell=$(DEMO_EPISODES)

test: $(VENV)/.installed  ## every quick test, on two cores
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow"

test-lowest: $(VENV)/.installed  ## every quick test, with the lowest versions of what the package needs
	$(PYTHON) -m venv .venv-lowest
	$(BIN)/python tests/scripts/lowest_versions.py > .venv-lowest/lowest.txt
	.venv-lowest/bin/pip install -q --upgrade pip
	.venv-lowest/bin/pip install -q -c .venv-lowest/lowest.txt . --group test --group engines
	.venv-lowest/bin/python -m pytest -n 2 --dist loadfile -m "not slow" -o filterwarnings=default

test-slow: $(VENV)/.installed  ## the heavy checks
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/pyright

check: lint test  ## everything a change must pass

validate: $(VENV)/.installed-validate  ## beside MuJoCo, roboticstoolbox, trimesh, SciPy: docs/fidelity
	$(BIN)/warpgrasp validate -o docs/fidelity

paper-docs: $(VENV)/.installed  ## the paper's experiments: docs/paper
	$(BIN)/warpgrasp paper -o docs/paper

sensitivity-docs: $(VENV)/.installed  ## the sensitivity table: docs/fidelity
	$(BIN)/warpgrasp sensitivity -o runs/sensitivity --workers $(WORKERS)
	cp runs/sensitivity/sensitivity.csv runs/sensitivity/sensitivity.md docs/fidelity/

errors-docs: $(VENV)/.installed  ## every strategy with errors of calibration and without: docs/fidelity/errors.md
	$(BIN)/warpgrasp sweep sweeps/studies/errors.toml -o runs/studies/errors --workers $(WORKERS)
	$(BIN)/warpgrasp table runs/studies/errors beside -o docs/fidelity/errors.csv
	$(BIN)/python docs/measured.py

models: $(VENV)/.installed  ## learn the models of the catalogue again, for recognition
	$(BIN)/warpgrasp learn catalogue --unlisted 64 --force \
		-o strategies/recognition/models.json

pictures: $(VENV)/.installed  ## the picture of the README: docs/images
	$(BIN)/python docs/overview.py docs/images/overview.png

figures: $(VENV)/.installed  ## collect every measured figure; fill README and docs from them
	$(BIN)/python docs/measured.py

studies-docs: $(VENV)/.installed  ## run the studies that ship; their leaderboards go to docs/studies
	for study in sweeps/studies/*.toml; do name=$$(basename $$study .toml); \
		$(BIN)/warpgrasp sweep $$study -o runs/studies/$$name --workers $(WORKERS) && \
		cp runs/studies/$$name/leaderboard.csv docs/studies/$$name.csv || exit 1; done
	for name in everyday held_out; do $(BIN)/warpgrasp leaderboard runs/studies/$$name \
		--metric normalized_chamfer -o docs/studies/$${name}_normalized.csv || exit 1; done
	$(BIN)/python docs/measured.py

$(VENV)/.installed-validate: $(VENV)/.installed requirements-validate.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-validate.lock
	touch $@

$(VENV)/.installed: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

bench: $(VENV)/.installed  ## measure this machine; the table goes to runs/bench/bench.md
	$(BIN)/warpgrasp bench -o runs/bench

lock:  ## pin every version with its hash, without addresses (needs uv)
	uv pip compile --universal --generate-hashes --no-header --python-version 3.11 --group dev pyproject.toml -o requirements.lock
	uv pip compile --universal --generate-hashes --no-header --python-version 3.11 --group dev --extra validate -c requirements.lock pyproject.toml -o requirements-validate.lock

clean:
	rm -rf $(VENV) .venv-lowest runs

docs: $(VENV)/.installed  ## the site in runs/docs/site, ready to be hosted; every link checked
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d runs/docs/trees docs runs/docs/site

notebook: $(VENV)/.installed  ## run the notebook and keep its outputs
	$(BIN)/python docs/notebook.py

docs-commands: $(VENV)/.installed  ## run every command and code block of the docs, small, in a copy
	$(BIN)/python tests/scripts/run_docs.py
