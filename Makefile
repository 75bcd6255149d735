# gyrostand: `make` turns the recordings of sample_data/ into checked tables, pages and a verdict;
# `make test` proves it. Both set up what they need, once, in .venv.
#
#   make                      RECORDINGS=folder  BUILD=folder   another input or output
#   make validate             audit only
#   make test                 the tests
#   make lint                 ruff, mypy, the floors of the house
#   make bench                benchmarks, with their peers in the same run
#   make nightly              long sweeps
#   make sample-data          make sample_data/ anew by the simulator
#   make lock                 resolve the requirements anew (needs uv)
#   make clean                remove the outputs (make distclean: and .venv)

RECORDINGS ?= sample_data
BUILD ?= build
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
GYROSTAND := $(BIN)/gyrostand
UV := $(shell command -v uv 2>/dev/null)

# A kernel's cache looks at the kernel's own file, and keeps what it took in of others: callees and constants.
KERNELS := pipeline/__pycache__/.kernels

.PHONY: all validate test lint bench nightly sample-data lock clean distclean
.DELETE_ON_ERROR:

all: $(VENV)/.ready | $(KERNELS)
	@rm -f -- "$(BUILD)/recordings.mk"; status=0; \
	$(GYROSTAND) discover "$(RECORDINGS)" --out "$(BUILD)" >/dev/null || status=$$?; \
	test -f "$(BUILD)/recordings.mk" || exit $$status; \
	ROOT="$$PWD" OUT="$(BUILD)" $(MAKE) --no-print-directory -s -k -C "$(BUILD)" -f recordings.mk \
		GYROSTAND="$(GYROSTAND)" pages || status=$$?; \
	$(GYROSTAND) report "$(BUILD)" --index || status=$$?; \
	$(GYROSTAND) check "$(BUILD)" || status=$$?; \
	$(GYROSTAND) verdicts "$(BUILD)" || status=$$?; \
	test $$status = 0 || echo "not everything is well: see above" >&2; \
	exit $$status

validate: $(VENV)/.ready | $(KERNELS)
	@$(GYROSTAND) validate "$(RECORDINGS)"

test: $(VENV)/.ready-dev | $(KERNELS)
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --strict benchmarks
	$(BIN)/lint-imports

bench: $(VENV)/.ready-dev | $(KERNELS)
	@for benchmark in benchmarks/[a-z]*.py; do $(BIN)/python "$$benchmark" || exit 1; done

nightly: $(VENV)/.ready-dev | $(KERNELS)
	HYPOTHESIS_PROFILE=nightly $(BIN)/python -m pytest -n auto -m "nightly or not nightly"

sample-data: $(VENV)/.ready | $(KERNELS)
	$(GYROSTAND) simulate samples --out sample_data

# One lock for every supported Python; hashes, no host names.
lock:
	uv pip compile --universal --no-header --generate-hashes --no-emit-index-url -q --python-version 3.11 \
		pyproject.toml --group build -o requirements.lock
	uv pip compile --universal --no-header --generate-hashes --no-emit-index-url -q --python-version 3.11 \
		pyproject.toml --group build --group test --group lint --group bench -c requirements.lock \
		-o requirements-dev.lock

$(KERNELS): $(wildcard pipeline/*/_kernels*.py) pipeline/models/ellipsoid.py pipeline/models/navigation_states.py
	@mkdir -p $(@D)
	@find pipeline -name '*.nb[ci]' -delete
	@touch $@

$(VENV)/.ready: requirements.lock pyproject.toml
	$(call install,requirements.lock)
	@touch $@

$(VENV)/.ready-dev: requirements-dev.lock pyproject.toml
	$(call install,requirements-dev.lock)
	@touch $@ $(VENV)/.ready

define install
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "gyrostand needs Python 3.11 or newer; set PYTHON=…")'
	@test -x $(BIN)/python || $(if $(UV),$(UV) venv -q --seed --python $(PYTHON),$(PYTHON) -m venv) $(VENV)
	@echo "setting up $(VENV) from $(1)"
	@$(if $(UV),$(UV) pip install -q --python $(BIN)/python,$(BIN)/python -m pip install -q --disable-pip-version-check) \
		--require-hashes -r $(1)
	@$(if $(UV),$(UV) pip install -q --python $(BIN)/python,$(BIN)/python -m pip install -q --disable-pip-version-check) \
		--no-build-isolation --no-deps -e .
endef

clean:
	rm -rf -- "$(BUILD)" dist

distclean: clean
	rm -rf -- $(VENV)
