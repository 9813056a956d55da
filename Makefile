# make demo   the whole story on the built-in stage        make test   everything CI runs
# Each sets up what it needs: a virtual environment in .venv with pinned packages, and the compiled parts.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
NATIVE_SOURCES := $(wildcard firmware/*/*.[ch] firmware/port/*/*.[ch] host/phaselead/*/kernel/*.[ch])

.PHONY: demo test bench lint generate setup clean

demo: $(STAMP)
	@$(BIN)/phaselead demo --out out/demo

test: $(STAMP)
	@sh tests/tools.sh
	@$(BIN)/python protocol/generate.py --check
	@$(MAKE) --no-print-directory lint
	@$(BIN)/python -m pytest -q -rs -n 2 --dist loadfile

bench: $(STAMP)
	@$(BIN)/python benchmarks/speed.py

lint: $(STAMP)
	@$(BIN)/ruff check host tests protocol benchmarks setup.py
	@$(BIN)/ruff format --check host tests protocol benchmarks setup.py
	@$(BIN)/clang-format --dry-run --Werror $$(find firmware host tests -name '*.[ch]')
	@$(BIN)/mypy

generate: $(STAMP)
	@$(BIN)/python protocol/generate.py
	@$(BIN)/python -m phaselead.effects.page

setup: $(STAMP)

$(STAMP): pyproject.toml setup.py $(NATIVE_SOURCES)
	@sh setup.sh $(PYTHON) $(VENV)
	@touch $@

clean:
	rm -rf $(VENV) build out host/*.egg-info host/phaselead/*/*.so
