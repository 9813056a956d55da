# make demo   the whole story on the built-in stage        make test   everything CI runs
# make toolchain   PlatformIO without its registry         make firmware   the boards' ELF files
# make manual   the manual as a site in out/manual         make picture   the moving picture of the README
# make links   the manual's links to other sites, for a maintainer with a network
# make package   sdist and wheel in dist/                  make lock   requirements*.lock from the ranges in pyproject.toml
# Each sets up what it needs: a virtual environment in .venv with pinned packages, and the compiled parts.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
NATIVE_SOURCES := $(wildcard firmware/*/*.[ch] firmware/port/*/*.[ch] host/phaselead/*/*.[ch] host/phaselead/*/*/*.[ch])

# Where PlatformIO finds what it would otherwise download; `pio run` by itself uses the registry.
PIO_CORE := .pio-core
PIO_STAMP := $(PIO_CORE)/.prepared
# Of fuzzing each target, in make test too.
SECONDS ?= 60
LOCK = $(BIN)/uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-annotate \
	--custom-compile-command "make lock"

BROWSER_DRIVER = $(BIN)/python -m pip install --disable-pip-version-check -q -r requirements-browser.lock

.PHONY: demo test manual links picture test-browser trials bench compare campaign link-trial storage-trial soak fuzz mutation coverage big-recording coverage-and-manual fuzz-those-installed lint generate setup package lock toolchain firmware budget clean

demo: $(STAMP)
	@$(BIN)/phaselead demo --out out/demo --overwrite

# What needs one core comes two at a time; -Otarget keeps their words apart.
TOGETHER = $(MAKE) --no-print-directory -j2 -Otarget
FUZZERS = $(BIN)/python -m pip install --disable-pip-version-check -q -r requirements-fuzz.lock

test: $(STAMP)
	@sh tests/tools.sh
	@! command -v chromium >/dev/null || $(BROWSER_DRIVER) || echo "note: without playwright the scope's page is not tested"
	@$(FUZZERS) || true
	@$(BIN)/python protocol/generate.py --check
	@$(TOGETHER) lint $$(! command -v arm-none-eabi-gcc >/dev/null || echo firmware)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -rs -n 2 --dist loadfile --no-loadscope-reorder \
		--durations 25
	@$(TOGETHER) fuzz-those-installed coverage-and-manual

coverage-and-manual: coverage
	@$(MAKE) --no-print-directory manual

fuzz-those-installed: $(STAMP)
	@$(BIN)/python tests/fuzz/fuzz.py --seconds $(SECONDS) --seed 1 --those-installed

# Every warning is an error: a link or an anchor that leads nowhere, a page that no list has, a notebook that fails.
manual: $(STAMP)
	@$(BIN)/python -m pip install --disable-pip-version-check -q -r requirements-docs.lock
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -q -E -W --keep-going -j 2 -d out/doctrees docs out/manual
	@echo out/manual/index.html

# Whether the manual's links to other sites still lead somewhere. A maintainer asks before a release; CI does not: it needs
# a network, and another site that is down is no fault of a change. The list is in out/links/output.txt.
links: $(STAMP)
	@$(BIN)/python -m pip install --disable-pip-version-check -q -r requirements-docs.lock
	@$(BIN)/python -m sphinx -q -E -b linkcheck -D nb_execution_mode=off -d out/doctrees-links docs out/links

picture: $(STAMP)
	@$(BIN)/python docs/moving_picture.py

# The scope's page in headless Chromium: the one of the distribution, which apt brings as root.
test-browser: $(STAMP)
	@command -v chromium >/dev/null || DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium
	@$(BROWSER_DRIVER)
	@$(BIN)/python -m pytest -q -m browser tests/scope

# Long examples of laws that `make test` tries on a quicker one.
trials: $(STAMP)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -m trial -n 2 --dist worksteal --durations 10

bench: $(STAMP)
	@$(BIN)/python benchmarks/start_up.py
	@$(BIN)/python benchmarks/speed.py

# Others' controllers and ours on seven stages: docs/compare.md. A run that was cut short goes on.
compare: $(STAMP)
	@OMP_NUM_THREADS=1 $(BIN)/python benchmarks/compare.py

# The blind trial behind docs/gap-campaign.md. SCALE=1 tries 608 cases; a run that was cut short goes on.
SET ?= sealed
SCALE ?= 0.3
campaign: $(STAMP)
	@$(BIN)/phaselead gap campaign --truth tests/gap/truth --set $(SET) --scale $(SCALE) -o out/campaign-$(SET) \
		--table docs/gap-campaign.md

# The trial behind docs/link.md: EACH commands of every kind over a line that goes wrong.
EACH ?= 10000
link-trial: $(STAMP)
	@$(BIN)/python tests/sim/link_trial.py --each $(EACH)

# 1,000 saves of an emulated board, most of them cut short, with bits that read either way: 20 minutes.
storage-trial: firmware
	@$(BIN)/python tests/emulated/storage_trial.py

# 10^8 ticks of a host that says anything, and 24 h of device time of one that works: 6 minutes.
soak: $(STAMP)
	@$(BIN)/python tests/soak/driver.py

# Inputs nobody thought of, SECONDS for each of the five targets; needs clang with libclang-rt.
fuzz: $(STAMP)
	@$(FUZZERS)
	@$(BIN)/python tests/fuzz/fuzz.py --seconds $(SECONDS)

# Breaks the firmware in 200 places, one at a time, and counts what the tests notice: hours. A run that was cut short goes on.
mutation: $(STAMP)
	@$(BIN)/python tests/mutation.py

# Branches of firmware/core and firmware/app that their tests take, at least 95 %: a minute of processor time, in make
# test too. The pages are in out/coverage/.
coverage: $(STAMP)
	@$(BIN)/python tests/coverage_of_c.py -n 2

# 44 h of one axis in virtual time: takes 10 GB for the journal and 3 GB beside it, and about 20 minutes.
big-recording: $(STAMP)
	@$(BIN)/python benchmarks/big_recording.py --gigabytes 10

lint: $(STAMP)
	@$(BIN)/ruff check host tests protocol firmware benchmarks docs/*.py docs/notebooks setup.py
	@$(BIN)/ruff format --check host tests protocol firmware benchmarks docs/*.py docs/notebooks setup.py
	@$(BIN)/clang-format --dry-run --Werror $$(find firmware host tests -name '*.[ch]')
	@$(BIN)/mypy
	@$(BIN)/python tests/static_analysis.py

generate: $(STAMP)
	@$(BIN)/python protocol/generate.py
	@$(BIN)/python -m phaselead.report.catalogue_page
	@$(BIN)/python -m phaselead.report.waveform_table
	@$(BIN)/python -m phaselead.api.page

setup: $(STAMP)

# The wheel is built from the sdist, in a folder of its own, with the locked setuptools.
package: $(STAMP)
	@$(BIN)/python -m build --no-isolation

# Keeps the versions that are there as far as the ranges allow; remove a line, or the file, to renew them.
lock: $(STAMP)
	@$(BIN)/python -m pip install --disable-pip-version-check -q uv
	@$(LOCK) --extra test -o requirements.lock pyproject.toml
	@$(LOCK) --extra test --extra browser -c requirements.lock -o requirements-browser.lock pyproject.toml
	@$(LOCK) --extra fuzz -c requirements.lock -o requirements-fuzz.lock pyproject.toml
	@$(LOCK) --extra test --extra docs -c requirements.lock -o requirements-docs.lock pyproject.toml
	@$(LOCK) --extra board -c requirements.lock -o requirements-board.lock pyproject.toml

toolchain: $(PIO_STAMP)

firmware: $(PIO_STAMP)
	@PLATFORMIO_CORE_DIR=$(PIO_CORE) $(BIN)/pio run -s

budget: firmware
	@$(BIN)/python benchmarks/budget.py

$(PIO_STAMP): $(STAMP) platformio.ini requirements-board.lock $(wildcard firmware/port/stm32f4/offline/*.py firmware/port/stm32f4/offline/platform/*/*)
	@$(BIN)/python -m pip install --disable-pip-version-check -q -r requirements-board.lock
	@$(BIN)/python firmware/port/stm32f4/offline/prepare.py $(PIO_CORE)
	@touch $@

$(STAMP): pyproject.toml requirements.lock setup.py setup.sh $(NATIVE_SOURCES)
	@sh setup.sh $(PYTHON) $(VENV)
	@touch $@

clean:
	rm -rf $(VENV) build dist out .pio $(PIO_CORE) host/*.egg-info host/phaselead/*/*.so
