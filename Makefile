# make demo | test | check: each makes .venv first, from nothing, where there is none.
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: demo test test-long test-both test-slow check docs dist install
.DEFAULT_GOAL := demo

# What is imported is compiled once, also where the environment says otherwise.
unexport PYTHONDONTWRITEBYTECODE

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "jaxsim needs Python 3.11 or newer; $(PYTHON) is older or does not run: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[test,check]'
	touch $@

demo: $(INSTALLED)
	$(BIN)/jaxsim train demo
	$(BIN)/jaxsim eval runs/demo
	$(BIN)/jaxsim simulate runs/demo --out runs/demo/simulated
	@echo; echo "Look at:"
	@echo "  runs/demo/evaluation/*.png         input | predicted | measured | difference, and scores.md"
	@echo "  runs/demo/simulated/previews/*.png simulated intensity and clouds"
	@echo "  runs/demo/simulated/clouds/        KITTI .bin, .pcd, .ply   (polar frames: simulated/polar/)"

# Each test is in one of the first two, or slow; test-slow runs all. test-both is the first two in one, which imports
# once, and once renders and compiles what short and long tests of a file share.
TESTS := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test: $(INSTALLED)
	$(TESTS) -m "not long and not slow"

test-long: $(INSTALLED)
	$(TESTS) -m "long and not slow"

test-both: $(INSTALLED)
	$(TESTS) -m "not slow"

test-slow: $(INSTALLED)
	$(TESTS)

check: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports

docs: $(INSTALLED)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/build/html
	@echo "docs/build/html/index.html"

# The same bytes from the same commit, whoever builds: times of files are those of the commit.
dist: $(INSTALLED)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt build hatchling
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/python -m build --no-isolation --outdir dist
	cd dist && sha256sum *
