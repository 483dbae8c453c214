# `make demo`, `make check` and `make test` work from a bare clone; `make help` lists every target.
# Most targets are commands of driftyard, which take options: make bench ARGS=--quick

.DEFAULT_GOAL := help
.PHONY: demo check unit test suite lint bench accuracy label-accuracy response bump replanning routing traffic cloud scenes gate gate-power experiments explain docs docs-serve notebooks clean help

VENV := .venv
READY := $(VENV)/.ready
BIN := $(VENV)/bin

# Tests start about 70 processes: without bytecode on the disk, each would compile all of NumPy,
# SciPy and Numba anew, for three seconds.
unexport PYTHONDONTWRITEBYTECODE

demo: $(READY)  ## generate a drive of 21 m, estimate, score and report it (into demo/)
	$(BIN)/driftyard demo

check: $(READY)  ## style, types, import layers, unit and property tests; no rendering
	@$(MAKE) --no-print-directory --jobs 2 lint unit

# Processes keep memory that they have freed: the kernel would clear the pages of each large array
# anew, which takes a tenth of the time.
unit suite: export MALLOC_MMAP_THRESHOLD_ := 1073741824
unit suite: export MALLOC_TRIM_THRESHOLD_ := 1073741824

unit: $(READY)
	$(BIN)/pytest -q -n 2 --dist loadfile -m "not gl and not slow" tests/unit tests/properties

test: $(READY)  ## style, types, import layers and every test, the small gate included
	@$(MAKE) --no-print-directory --jobs 2 suite lint

# One process more than two cores: some tests wait for processes of their own.
PROCESSES := $(shell n=$$(nproc); echo $$(( n < 3 ? 3 : n > 4 ? 4 : n )))

# Bytes of two recordings differed in one of 4,000 tests in two whole runs, and in no repetition; the
# cause is not found. So tests that fail run once more, alone.
PARALLEL := -n $(PROCESSES) --dist loadfile --no-loadscope-reorder
AGAIN := --last-failed --last-failed-no-failures none

# Workers that start without machine code would all compile the same, each for itself.
suite: $(READY)
	$(BIN)/python -c "from vo.precompile import compile_ahead; compile_ahead()"
	$(BIN)/pytest $(PARALLEL) || { test $$? -eq 1 && $(BIN)/pytest $(AGAIN); }

lint: $(READY)  ## style, types and the layers of the imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyrefly check --summary=none --python-interpreter-path $(BIN)/python
	$(BIN)/lint-imports

bench: $(READY)  ## speed of estimator and generator on this machine
	$(BIN)/driftyard bench $(ARGS)

accuracy: $(READY)  ## drift of the default settings on ten drives
	$(BIN)/driftyard accuracy $(ARGS)

scenes: $(READY)  ## picture of all scenes for the README
	$(BIN)/driftyard preview all --out docs/images/scenes.jpg

label-accuracy: $(READY)  ## accuracy of labels, blur and sensors, beside the promised one
	$(BIN)/driftyard label-accuracy $(ARGS)

response: $(READY)  ## drift under every disturbance and on every scene (hours)
	$(BIN)/driftyard response $(ARGS)

bump: $(READY)  ## figure of a brick under a wheel in every channel
	$(BIN)/driftyard bump $(ARGS)

replanning: $(READY)  ## time of D* Lite and of A* on a grid
	$(BIN)/driftyard replanning $(ARGS)

routing: $(READY)  ## static and dynamic routing, with and without clearing (into build/routing/)
	$(BIN)/driftyard route --out build/routing $(ARGS)

traffic: $(READY)  ## install Eclipse SUMO (250 MB) and run its tests
	$(BIN)/python -m pip install --quiet --editable ".[traffic]"
	$(BIN)/pytest -q tests/e2e/test_route_grid.py

cloud: $(READY)  ## install clients of buckets and clusters (150 MB) and run their tests
	$(BIN)/python -m pip install --quiet --editable ".[cluster,parquet]" --group cloud
	$(BIN)/pytest -q tests/e2e/test_locations.py tests/unit/test_store.py tests/unit/test_queues.py

gate: $(READY)  ## compare the default estimator with tests/gate/baseline.json
	$(BIN)/driftyard gate check --baseline tests/gate/baseline.json --accept datasets,platform $(ARGS)

gate-power: $(READY)  ## false alarm rate and power of the gate, by simulation
	$(BIN)/driftyard gate power $(ARGS)

experiments: $(READY)  ## test the claims of the thesis (docs/experiments.md; an hour or more)
	$(BIN)/driftyard experiment all --page docs/experiments.md

explain: $(READY)  ## attribute the drift on six scenes (docs/explain.md; half an hour)
	$(BIN)/driftyard explain --scene brick_court,office,asphalt,corridor,meadow,dusk \
	  --seeds 3 --distance 4 --out docs/images/explain --page docs/explain.md $(ARGS)

docs: $(BIN)/mkdocs  ## the site (into build/site; open index.html)
	$(BIN)/mkdocs build --strict --quiet

docs-serve: $(BIN)/mkdocs  ## the site while pages are edited
	$(BIN)/mkdocs serve

notebooks: $(BIN)/mkdocs  ## run the notebooks and store their outputs
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python docs/notebooks.py

$(BIN)/mkdocs: $(READY)
	$(BIN)/python -m pip install --quiet --group docs

clean:  ## remove results and caches; the environment in .venv stays
	rm -rf build demo dist .pytest_cache .hypothesis .ruff_cache .import_linter_cache
	find driftyard scenes sim vo trials tests -name __pycache__ -type d -exec rm -rf {} +

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-16s%s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(READY): pyproject.toml .ci/setup
	sh .ci/setup $(VENV)
	@touch $@
