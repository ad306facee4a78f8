# Everything happens in a virtual environment of this folder; only Python 3.10+, a C++20 compiler, make and
# git have to be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(shell find cmake cpp python/clothsim -type f ! -name '*.pyc')

.PHONY: demo test bench clean

demo: $(VENV)/.built-demo
	$(BIN)/clothsim reproduce --quick --out report

test: $(VENV)/.built-test
	$(BIN)/python -m pytest

bench: $(VENV)/.built-bench
	$(BIN)/clothsim bench

# One build serves all; a stamp per extra, so that the demo does not bring the test tools.
$(VENV)/.built-%: $(SOURCES) | $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check '.[$*]'
	touch $@

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV) build report
