# Two commands do everything: make demo, make test. PYTHON and VENV may be set.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: demo wheel test long check docs docs-html notebooks pages faults-random bench-smoke clean

DEMO_KERNELS := cutting.sweep_kernels evaluate.path_matching evaluate.swept_section plan.cut_kernel plan.elastic_motion_kernel \
	plan.feed_schedule plan.sag_and_play programs robot.elasticity.kernels.batch robot.elasticity.play robot.elasticity.servo \
	robot.kinematics signals.preview twin.plant.applied_forces twin.plant.chip twin.plant.friction twin.plant.loads

demo: $(VENV)/.installed-run  ## Install, run the main job on embedded data, print a table, write an HTML report.
	$(BIN)/counterflex warm $(DEMO_KERNELS)
	$(BIN)/counterflex demo --out out/demo
	@echo "To use the command in this terminal: source $(BIN)/activate"

# Some tests wait for a clock, a port or a process: one worker more than there are cores keeps these busy.
WORKERS := $(shell $(PYTHON) -c "import os; print((os.cpu_count() or 1) + 1)")
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: $(VENV)/.installed-dev  ## Install, run the tests but the long ones; with TURN=1 also those of this commit's third.
	$(PYTEST) $(if $(TURN),--turn,-m "not long")

long: $(VENV)/.installed-dev faults-random bench-smoke  ## What `make test` leaves out: long tests, faults at random, benchmarks.
	$(PYTEST) -m "long or hypothesis"

check: $(VENV)/.installed-dev  ## Linter, formatter, type checker, import contracts, frame names, structure, licences.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/check_frames.py src lab tests examples benchmarks
	$(BIN)/python tools/check_nomenclature.py
	$(BIN)/python tools/measure_structure.py --hold
	$(BIN)/python tools/supply_chain.py --check

docs: $(VENV)/.installed-dev  ## Run every example and every command printed in the docs.
	$(BIN)/python tools/run_docs.py $(if $(TURN),--turn)

docs-html: $(VENV)/.installed-dev  ## Run the example gallery and build the documentation as HTML in docs/_build/html.
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo docs/_build/html/index.html

notebooks: $(VENV)/.installed-dev  ## Write the example gallery as notebooks in out/notebooks.
	$(BIN)/python tools/notebooks.py out/notebooks

pages: $(VENV)/.installed-dev  ## Open report pages in Chromium at three widths and on A4.
	$(BIN)/counterflex compensate examples/programs/groove.ngc --cell examples/cells/kr300_d16_small.toml --out out/pages/plan
	$(BIN)/counterflex prove examples/programs/groove.ngc --cell examples/cells/kr300_d16_small.toml --out out/pages/proof
	$(BIN)/counterflex quote examples/tolerances.csv examples/programs/groove.ngc examples/cells/kr300_d16_small.toml --out out/pages/quote
	$(BIN)/python tools/check_pages.py out/pages/plan/report.html out/pages/proof/report.html out/pages/quote/report.html

faults-random: $(VENV)/.installed-dev  ## Compose faults at random: fixed seeds must hold, those from the commit's number are reported.
	$(BIN)/counterflex faults --random --minutes 5 --seed 6000 --out out/faults-random
	seed=$$(printf '%d' 0x$$(git rev-parse --short=7 HEAD)) && echo "seed $$seed" && \
	{ $(BIN)/counterflex faults --random --minutes 2 --seed $$seed --out out/faults-new || \
	{ test $$? -eq 1 && echo "a rule is broken with a new seed, see out/faults-new/stories.json"; }; }

bench-smoke: $(VENV)/.installed-dev  ## Run every benchmark briefly, two at a time: whether they work, not how fast.
	$(BIN)/python tools/run_benchmarks.py $(if $(TURN),--turn)

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed-run: requirements/run.txt pyproject.toml | $(BIN)/python
	$(PIP) install --require-hashes -r requirements/run.txt
	$(PIP) install --no-build-isolation --no-deps -e .
	touch $@

$(VENV)/.installed-dev: requirements/dev.txt pyproject.toml lab/pyproject.toml | $(BIN)/python
	$(PIP) install --require-hashes -r requirements/dev.txt
	$(PIP) install --no-build-isolation --no-deps -e . -e lab
	touch $@ $(VENV)/.installed-run

wheel: $(VENV)/.installed-dev  ## Build the wheel with its compiled kernels in dist, install it in an empty environment, time first commands.
	$(BIN)/python tools/build_wheels.py dist --time

clean:
	rm -rf $(VENV) out build dist docs/_build docs/gallery .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks
