# make demo    set everything up, run the quick study, say where its report is
# make test    set everything up, run the tests; test-networks and test-slow run the others
# make docs    set everything up, build the documentation site into build/docs
# make answers write which resolution is enough, from docs/results/paper, into README and docs
# make constraints  take the newest packages, write their versions into constraints.txt
PYTHON ?= python3
RUN ?= runs/quick
BIN := .venv/bin
CONSTRAINTS ?= -c constraints.txt
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile $(CONSTRAINTS)

# Python may keep its bytecode in .venv and in __pycache__, or each process would compile it again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-networks test-slow docs answers lint format bench clean constraints

demo: .venv/.ready .venv/.llvm
	$(BIN)/eres study --preset quick --out $(RUN)

# Two files at a time: each may hold a scene of a gigabyte.
test: .venv/.bytecode .venv/.llvm
	$(BIN)/pytest -q -n 2 --dist loadfile --no-loadscope-reorder

# Without PyTorch, `make test` skips these.
test-networks: .venv/.learned .venv/.bytecode .venv/.llvm
	$(BIN)/pytest -q -n 2 --dist loadfile tests/tasks/test_datasets.py tests/tasks/test_firenet.py \
	  tests/tasks/test_learned_networks.py tests/tasks/test_random_crops.py \
	  tests/tasks/test_training.py tests/test_damaged_files.py

test-slow: .venv/.learned .venv/.bytecode .venv/.llvm .venv/.chromium
	$(BIN)/pytest -q -m slow

docs: .venv/.docs
	$(BIN)/sphinx-build -q -E -W --keep-going docs build/docs
	@echo "eres: build/docs/index.html"

answers: .venv/.ready
	$(BIN)/python docs/answers.py docs/results/paper README.md docs/results.md docs/results_run.md
	$(BIN)/python docs/answers.py docs/results/chip docs/chip.md
	$(BIN)/python docs/answers.py docs/results/firenet docs/learned.md
	$(BIN)/python docs/answers.py docs/results/firenet_slider docs/virtual_slider.md
	$(BIN)/python docs/answers.py docs/results/paper-v2e docs/v2e.md
	$(BIN)/python docs/answers.py docs/results/paper-seeds docs/seeds.md

lint: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: .venv/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: .venv/.dev .venv/.llvm
	$(BIN)/python benchmarks/bench_sensor.py
	$(BIN)/python benchmarks/bench_render.py
	$(BIN)/python benchmarks/bench_formats.py
	$(BIN)/python benchmarks/bench_methods.py
	$(BIN)/python benchmarks/bench_tracking.py

clean:
	rm -rf .venv build  # never runs: they take hours

constraints: clean
	$(MAKE) CONSTRAINTS= .venv/.learned
	$(BIN)/pip freeze --exclude-editable | sed 's/+cpu//' >constraints.txt

# The study, and videos for the commands of README.
.venv/.ready: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv || { \
	  echo "eres: could not make .venv with $(PYTHON); it needs Python 3.11 or newer with venv" \
	    "(Debian: apt-get install python3-venv)"; exit 1; }
	@echo "eres: installing into .venv (about a minute the first time)"
	@$(INSTALL) --editable '.[study,video]'
	@touch $@

.venv/.dev: .venv/.ready
	@$(INSTALL) --editable '.[dev]'
	@touch $@

# The smallest build of PyTorch. Where pip does not find it, the tests of networks are skipped.
TORCH := torch==2.13.0+cpu

.venv/.learned: .venv/.dev
	@echo "eres: installing PyTorch for the tests of networks"
	@$(INSTALL) '$(TORCH)' --editable '.[learned]' || \
	  echo "eres: no $(TORCH) could be installed; the tests of networks are skipped"
	@touch $@

# All packages at once, on all cores; otherwise each process of the tests would compile them anew.
.venv/.bytecode: .venv/.dev
	@$(BIN)/python -m compileall -q -j 0 .venv/lib >/dev/null || true  # some packages have templates
	@touch $@

.venv/.docs: .venv/.ready
	@$(INSTALL) --editable '.[docs]'
	@touch $@

AS_ROOT := $(shell test "$$(id -u)" = 0 || echo "sudo -n")

# The report is tested in a browser; where there is none, those tests are skipped.
HAS_CHROMIUM := command -v chromium || command -v chromium-browser || command -v google-chrome || \
  command -v google-chrome-stable

.venv/.chromium: .venv/.dev
	@{ $(HAS_CHROMIUM); } >/dev/null || { \
	  if command -v apt-get >/dev/null && $(AS_ROOT) true 2>/dev/null; then \
	    echo "eres: installing Chromium for the tests of the report with apt-get"; \
	    $(AS_ROOT) apt-get -qq update >/dev/null 2>&1; \
	    $(AS_ROOT) apt-get -qq install --yes --no-install-recommends chromium >/dev/null 2>&1 || \
	      echo "eres: no Chromium could be installed; the tests of the report in a browser are skipped"; \
	  fi; }
	@touch $@

# Mitsuba's fast variant needs an LLVM that works with it; some releases end the process.
RENDERS_FAST := $(BIN)/python -c "import sys; from eres_render.rendering.backend import VARIANTS, probe_variant; \
  sys.exit(not any(probe_variant(name).works for name in VARIANTS if name != 'scalar_rgb'))"

.venv/.llvm: .venv/.ready
	@$(RENDERS_FAST) || { \
	  if command -v apt-get >/dev/null && $(AS_ROOT) true 2>/dev/null; then \
	    echo "eres: installing LLVM for Mitsuba with apt-get"; \
	    $(AS_ROOT) apt-get -qq update >/dev/null 2>&1; \
	    for package in libllvm19 libllvm18 libllvm20 libllvm17 libllvm16; do \
	      $(AS_ROOT) apt-get -qq install --yes $$package >/dev/null 2>&1 && $(RENDERS_FAST) && break; \
	    done; \
	  fi; \
	  $(RENDERS_FAST) || \
	    echo "eres: no LLVM that works with Mitsuba was found, so renders will be 25x to 60x slower." \
	      "Install one (Debian, Ubuntu: apt-get install libllvm19), then rm .venv/.llvm"; }
	@touch $@
