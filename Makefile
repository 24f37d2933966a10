# make demo | test | slow | lint | docs | bench | pages | bench-peers | bench-peers-gradient | clean    what to pass on: make demo ARGS=--fast
# Needs make and Python with venv; everything else is installed into .venv.

VENV ?= .venv
BIN := $(VENV)/bin
SUPPORTED := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(or $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c '$(SUPPORTED)' 2>/dev/null && echo $$p && break; done),python3)
DEBIAN_VENV = $(or $(filter python3.%,$(notdir $(PYTHON))),python3)-venv
QUADMATH := libquadmath.so.0
export OPENBLAS_NUM_THREADS := 1

.PHONY: demo test slow lint docs bench pages bench-peers bench-peers-gradient clean check

demo: $(VENV)/.demo
	$(BIN)/python -m ngbrain demo $(ARGS)

# A process for each core; a file's tests stay in one but for the last ones, so that fixtures are made once.
test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist worksteal $(ARGS)

# The long tests, then the others once more with meshes, time steps and loads moved in their last digits: no bound hangs on these.
PERTURB ?= 1
slow: $(VENV)/.dev
	$(BIN)/python -m pytest -m slow -o faulthandler_timeout=0 $(ARGS)
	$(BIN)/python -m pytest -n auto --dist worksteal --perturb $(PERTURB) $(ARGS)

lint: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/check_docstrings.py

# The site, out/docs/index.html. Lessons are executed where NOTEBOOKS, a folder of executed ones, lacks them; ARGS=--fast leaves that out.
docs: $(VENV)/.dev
	$(BIN)/python tutorials/guide/builder $(if $(NOTEBOOKS),--notebooks $(NOTEBOOKS)) $(ARGS)

# Each benchmark's last line is its JSON.
bench: $(VENV)/.dev
	@mkdir -p out/bench
	@for script in benchmarks/[!_]*.py; do name=$$(basename $$script .py); echo "$$script --json $(ARGS)"; \
		$(BIN)/python $$script --json $(ARGS) > out/bench/$$name.txt && tail -n 1 out/bench/$$name.txt > out/bench/$$name.json \
		|| exit 1; done

# The pages of benchmarks/results, of the records beside the benchmarks.
pages: $(VENV)/.dev
	$(BIN)/python benchmarks/_pages.py

# The solvers that benchmarks compare with, each in an environment of its own; dolfinx and JAX-FEM need Python 3.12.
PEERS ?= out/peers
PEER_PYTHON312 ?= $(shell for p in python3.12 python3.13 python3.14 $(HOME)/.pyenv/versions/3.1[2-9]*/bin/python3; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && echo "$$p" && break; done)

bench-peers: $(PEERS)/felupe/.done $(PEERS)/skfem/.done $(PEERS)/dolfinx/.done

# Those that only gradients are compared with: several GB for torch.
bench-peers-gradient: $(PEERS)/torchfem/.done $(PEERS)/jaxfem/.done

$(PEERS)/%/.done: interpreter = $(PYTHON)
$(PEERS)/dolfinx/.done $(PEERS)/jaxfem/.done: interpreter = $(PEER_PYTHON312)
$(PEERS)/%/.done: benchmarks/peers/requirements-%.txt | check
	@python="$(interpreter)"; if test -z "$$python"; then \
		echo "$* is left out: it needs Python 3.12 or newer; make $(MAKECMDGOALS) PEER_PYTHON312=/path/to/python3.12"; \
	else "$$python" -m venv --clear $(@D) && \
		$(@D)/bin/pip install --quiet --disable-pip-version-check -r $< && \
		for alone in $(wildcard benchmarks/peers/alone-$*.txt); do \
			$(@D)/bin/pip install --quiet --disable-pip-version-check --no-deps -r $$alone || exit 1; done && touch $@; fi

clean:
	rm -rf build dist out *.egg-info .cache .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find ngbrain meshes tests tutorials benchmarks -name __pycache__ -prune -exec rm -rf {} +

# One line that says what to install, or nothing.
check:
	@command -v "$(PYTHON)" >/dev/null || \
		{ echo "Python is missing ($(PYTHON)): apt install python3 python3-venv"; exit 1; }
	@"$(PYTHON)" -c '$(SUPPORTED)' || { echo "ngbrain needs Python 3.11 or newer and found $$("$(PYTHON)" -V 2>&1):" \
		"apt install python3 python3-venv on Debian 12 or newer, or make PYTHON=/path/to/python3"; exit 1; }
	@"$(PYTHON)" -m ensurepip --version >/dev/null 2>&1 || \
		{ echo "$(PYTHON) has no venv module: apt install $(DEBIAN_VENV)"; exit 1; }

$(BIN)/pip: | check
	"$(PYTHON)" -m venv --clear $(VENV)

# NGSolve's wheel expects $(QUADMATH) from the system; where that is missing, SciPy's wheel brings one that serves.
$(VENV)/.demo: extras := demo
$(VENV)/.dev: extras := dev,demo
$(VENV)/.demo $(VENV)/.dev: setup.cfg pyproject.toml | $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --no-compile --editable ".[$(extras)]"
	@$(BIN)/python -c 'import ctypes; ctypes.CDLL("$(QUADMATH)")' 2>/dev/null || \
		{ cd $(VENV)/lib/python3*/site-packages && set -- scipy.libs/libquadmath-* && \
		test ! -e "$$1" || ln -sf "../$$1" ngsolve_openblas/$(QUADMATH); }
	@$(BIN)/python -c 'import ngsolve'
	@touch $@ $(if $(filter %.dev,$@),$(VENV)/.demo)
