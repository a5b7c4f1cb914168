# Two commands are all there is to know: `make demo` and `make test`. Both set everything up in .venv first; `make nightly`
# runs the slow truth, `make docs` builds the site.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

# Four workers share two cores: what is live waits for its time. Threads inside of them would only get into each other's
# way. Compiled modules are kept whatever the shell says of that: tests start a hundred processes, each would compile the
# package anew.
FOR_TESTS := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=

.PHONY: demo test docs nightly fresh compiled lint types imports script unit coverage bench bench-peer schema format clean

demo: fresh
	$(BIN)/aerodft demo --output demo

# Warnings (broken links, names and cross-references) are errors, which `--quiet` would hide; `make test` builds it too.
docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo 'open build/site/index.html; to search, serve it: $(BIN)/python -m http.server --bind 127.0.0.1 --directory build/site 8000'

# What is wrong in seconds is said at once; types take one core half a minute, beside the first tests.
test: lint imports script
	@$(MAKE) --no-print-directory -j 2 types unit

# uv where it is there (seconds instead of a minute), else pip.
$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v < (3, 14) else f"Python {v[0]}.{v[1]}: aerodft needs 3.11 to 3.13; make PYTHON=python3.12")'
	@if command -v uv >/dev/null 2>&1; then \
		uv venv --quiet --allow-existing --python $(PYTHON) $(VENV) && \
		VIRTUAL_ENV=$(CURDIR)/$(VENV) uv pip install --quiet --constraint constraints.txt --editable '.[dev]'; \
	else \
		$(PYTHON) -m venv $(VENV) && \
		$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'; \
	fi
	@touch $@

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# Helpers of tests are checked too: all of tests but the tests, benchmarks and fixtures.
types: $(INSTALLED)
	$(BIN)/mypy
	$(BIN)/mypy --explicit-package-bases $$(find tests -name '*.py' | grep -Ev '/(test_|bench_|peer_|conftest|__init__)')

imports: $(INSTALLED)
	$(BIN)/lint-imports

# Types and lint of the page's script, where Node is there and its tools can be had.
SCRIPT := build/script
script:
	@mkdir -p $(SCRIPT) && cp -p tests/script/* $(SCRIPT)
	@if ! command -v npm >/dev/null 2>&1; then echo "no Node: the page's script is not checked"; \
	elif ! { [ $(SCRIPT)/node_modules/.package-lock.json -nt $(SCRIPT)/package.json ] || \
		(cd $(SCRIPT) && timeout 60 npm install --silent --no-package-lock --no-audit --no-fund --fetch-retries=0); }; then \
		echo "its tools cannot be installed: the page's script is not checked"; \
	else $(SCRIPT)/node_modules/.bin/tsc -p $(SCRIPT) && \
		$(SCRIPT)/node_modules/.bin/eslint -c $(SCRIPT)/eslint.config.js aerodft/web/static; fi

PYTEST := $(FOR_TESTS) $(BIN)/pytest -n 4 --dist loadfile --no-loadscope-reorder --benchmark-disable -q

# Compiled loops are kept. numba knows a loop's own file, not those of the loops in it: what is older than any is dropped.
fresh: $(INSTALLED)
	@newest=$$(ls -t $$(grep -rl --include='*.py' njit aerodft calibration replay) | head -n 1) && \
		find aerodft calibration replay -name '*.nb[ic]' ! -newer "$$newest" -delete

# Loops are compiled at their first call: once here, so that four workers do not all do it.
compiled: fresh
	@to=$$(mktemp -d) && trap 'rm -rf "$$to"' EXIT && \
		$(FOR_TESTS) $(BIN)/aerodft import samples/copter.tlog --config configs/services/river-flight.toml -o $$to/rec 2>/dev/null && \
		$(FOR_TESTS) $(BIN)/python -m aerodft.sim --out $$to/flight --duration 2 --size 320x240 >/dev/null

unit: compiled
	$(PYTEST) -m "not nightly"

# Slow truth: statistics over random scenes, memory, faults at full scale.
nightly: compiled
	AERODFT_FAULTS=full $(PYTEST) --timeout=1800 -m nightly

# Twice as slow as without.
coverage: $(INSTALLED)
	$(PYTEST) --cov --cov-report=term:skip-covered

bench: $(INSTALLED)
	$(BIN)/python tests/bench/bench_query.py
	$(BIN)/python tests/bench/bench_tlog.py
	$(BIN)/python tests/bench/bench_tracked.py
	$(BIN)/python tests/bench/bench_import.py
	$(BIN)/python tests/bench/bench_dense.py
	$(BIN)/python tests/bench/bench_terrain.py
	$(BIN)/python tests/bench/bench_calibration.py
	$(BIN)/python tests/bench/bench_sync.py
	$(BIN)/python tests/bench/bench_full_disk.py
	$(BIN)/python tests/bench/bench_replay.py
	$(BIN)/python tests/bench/bench_batch.py
	$(BIN)/python tests/bench/bench_memory.py

# Needs the network once: the peer is installed in an environment of its own.
bench-peer: $(INSTALLED)
	$(BIN)/python tests/bench/bench_cameratransform.py
	$(BIN)/python tests/bench/bench_calibration.py --peer

# The schemas of all payloads as files, for who reads them in other languages.
schema: $(INSTALLED)
	$(BIN)/python -c 'from pathlib import Path; from aerodft.adapters.wire.schemas import SCHEMAS, schema_text; \
		[Path("docs/schema", f"{n[8:].replace(chr(47), chr(45))}.json").write_bytes(schema_text(n)) for n in SCHEMAS]'

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) .venv-peer demo build *.egg-info
