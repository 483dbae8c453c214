# `make demo` and `make test` work from a bare clone; `make help` lists every target.
# `make bench` and `make accuracy` take options: make bench ARGS=--quick

.DEFAULT_GOAL := help
.PHONY: demo test lint compile bench accuracy proof response bump replan routing scenes gate gate-power experiments explain clean help

VENV := .venv
READY := $(VENV)/.ready
BIN := $(VENV)/bin

# pyright would ask the network for a newer release at every call.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

demo: $(READY)  ## generate a drive of 21 m, estimate, score and report it (into demo/)
	$(BIN)/driftyard demo

test: $(READY)  ## lint, then every test
	@$(MAKE) --no-print-directory --jobs 2 lint compile
	$(BIN)/pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# Workers that start without machine code would all compile the same, each for itself.
compile: $(READY)
	$(BIN)/driftyard generate office --out build/first --overwrite --set drive.distance_m=0.3
	$(BIN)/driftyard run build/first --out build/first.txt

lint: $(READY)  ## style, types and the layers of the imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

bench: $(READY)  ## speed of estimator and generator on this machine
	$(BIN)/python -m trials.studies.bench $(ARGS)

accuracy: $(READY)  ## drift of the default settings on ten drives
	$(BIN)/python -m trials.studies.accuracy $(ARGS)

scenes: $(READY)  ## picture of all scenes for the README
	$(BIN)/driftyard preview all --out docs/images/scenes.jpg

proof: $(READY)  ## how exact labels, blur and sensors are, beside what is promised
	$(BIN)/python -m trials.studies.label_accuracy $(ARGS)

response: $(READY)  ## what every disturbance and every scene costs the baseline (hours)
	$(BIN)/python -m trials.studies.response $(ARGS)

bump: $(READY)  ## what a brick under a wheel does to every channel, as a figure
	$(BIN)/python -m trials.studies.bump $(ARGS)

replan: $(READY)  ## how much faster D* Lite replans on a grid than A* plans anew
	$(BIN)/python -m trials.studies.replanning $(ARGS)

routing: $(READY)  ## static and dynamic routing, with and without clearing (into build/routing/)
	$(BIN)/driftyard route --out build/routing $(ARGS)

gate: $(READY)  ## this repository's own gate: has the default estimator regressed?
	$(BIN)/driftyard gate --baseline tests/gate/baseline.json --accept datasets,platform $(ARGS)

gate-power: $(READY)  ## how often the gate errs, by simulation
	$(BIN)/python -m trials.studies.gate_power $(ARGS)

experiments: $(READY)  ## the thesis' claims, tested (docs/experiments.md; an hour or more)
	$(BIN)/driftyard experiment all --page docs/experiments.md

explain: $(READY)  ## where the drift comes from, for six scenes (docs/explain.md; half an hour)
	$(BIN)/driftyard explain --scene brick_court,office,asphalt,corridor,meadow,dusk \
	  --seeds 3 --distance 4 --out docs/images/explain --page docs/explain.md $(ARGS)

clean:  ## remove results and caches; the environment in .venv stays
	rm -rf build demo dist .pytest_cache .hypothesis .ruff_cache .import_linter_cache
	find scenes sim vo trials tests -name __pycache__ -type d -exec rm -rf {} +

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s%s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(READY): pyproject.toml .ci/setup
	sh .ci/setup $(VENV)
	@touch $@
