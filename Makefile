# Two commands do everything: `make demo` and `make test`. They need Python 3.11+ with venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_EPISODES ?= 64
DEMO_DIR ?= runs/demo
WORKERS ?= 2

.PHONY: demo test test-slow lint check lock clean docs

demo: $(VENV)/.installed  ## environment, install, the demo sweep, its leaderboard
	$(BIN)/warpgrasp sweep sweeps/studies/demo.toml -o $(DEMO_DIR) --workers $(WORKERS) \
		--set episodes_per_cell=$(DEMO_EPISODES)

test: $(VENV)/.installed  ## every quick test, on two cores
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow"

test-slow: $(VENV)/.installed  ## the heavy checks
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/pyright

check: lint test  ## everything a change must pass

$(VENV)/.installed: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

lock:  ## pin every version with its hash, without addresses (needs uv)
	uv pip compile --universal --generate-hashes --no-header --python-version 3.11 --group dev pyproject.toml -o requirements.lock

clean:
	rm -rf $(VENV) runs

docs: $(VENV)/.installed  ## the pages and the API reference, every link checked
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d runs/docs/trees docs runs/docs/site
