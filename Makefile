# Every target works in a fresh clone: it makes .venv when there is none and installs what Python and LLVM lack where it may.
.PHONY: demo test test-all check style doctest bench validate docs
.DELETE_ON_ERROR:

# Compiled modules are kept, whatever the environment says: the tests start many processes.
unexport PYTHONDONTWRITEBYTECODE

PYTHON ?= python3
PY := .venv/bin/python
# `make demo` needs the package alone; tests, style and benchmarks need the extra [dev] as well, torch with it.
STAMP := .venv/.installed
DEV := .venv/.dev
# Files go to one process each, in the order that tests/conftest.py gives them.
SPREAD := --dist loadfile --no-loadscope-reorder

demo: $(STAMP)
	$(PY) examples/demo.py

# The tests of each change; `slow` marks those that run before a release and after a change to what they guard.
test: $(DEV)
	$(PY) -m pytest -q -n 2 $(SPREAD) -m "not slow"

test-all: $(DEV)
	$(PY) -m pytest -q -n 2 $(SPREAD)

# Formatter, linter, types, doctests and tests (the import layers are among them: tests/house/test_layers.py).
check: style doctest test

style: $(DEV)
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/mypy

doctest: $(DEV)
	$(PY) -m pytest -q --doctest-modules t2d_rt

bench: $(DEV)
	$(PY) -m validation.bench

validate: $(DEV)
	$(PY) -m validation

# The site, offline, in out/site; tutorials and gallery run once and again where they have changed.
docs: .venv/.docs
	$(PY) -m sphinx -q -W --keep-going -b html docs out/site

$(DEV): EXTRA = dev
.venv/.docs: EXTRA = docs
$(DEV) .venv/.docs: $(STAMP)
	$(PY) -m pip install --quiet --disable-pip-version-check -e ".[$(EXTRA)]"
	@touch $@

# The stamp is older than pyproject.toml when dependencies may have changed.
$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' || \
		{ echo "t2d-rt needs Python 3.11 to 3.13, $(PYTHON) is $$($(PYTHON) --version 2>&1); call make PYTHON=python3.12" >&2; exit 2; }
	@test -x $(PY) || $(PYTHON) -c 'import ensurepip' 2>/dev/null || $(MAKE) --no-print-directory install-venv
	test -x $(PY) || $(PYTHON) -m venv .venv
	$(PY) -m pip install --quiet --disable-pip-version-check -e .
	@$(PY) -c 'from t2d_rt.core.backend import require_llvm; require_llvm()' 2>/dev/null || $(MAKE) --no-print-directory install-llvm
	@touch $@

# What pip does not bring by itself: LLVM, a wheel of which is taken where apt may not be used, and on Debian and Ubuntu the part of Python
# that makes virtual environments.
# The tests of the viewer look at its page in Chromium; without one they are skipped.
.PHONY: install-llvm install-venv install-chromium
install-llvm: PACKAGE = libllvm19
install-llvm: NEEDED = LLVM 17 or newer: run 'sudo apt-get install libllvm19' (or set DRJIT_LIBLLVM_PATH), then make again
install-llvm: WHEEL = [llvm]
install-venv: PACKAGE = $$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
install-venv: NEEDED = Python's venv: run 'sudo apt-get install python3-venv', then make again
install-chromium: PACKAGE = chromium
install-chromium: NEEDED = Chromium for the tests of the viewer, which are skipped without: run 'sudo apt-get install chromium'
install-llvm install-venv install-chromium:
	@if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(PACKAGE); \
	elif [ -n "$(WHEEL)" ] && [ "$$(uname -sm)" = "Linux x86_64" ]; then \
		$(PY) -m pip install --quiet --disable-pip-version-check -e ".$(WHEEL)"; \
	else \
		echo "t2d-rt needs $(NEEDED)" >&2; \
		exit 2; \
	fi
