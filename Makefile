# What a person types. Every target does its own set-up and says what it is doing.
#   make demo   the main job with no hardware: acquire, record, verify, encode, classify, figures
#   make test   checks and the whole test suite, the firmware in the loop included

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PEERS := .peers
READERS := .readers
SAY := @printf '==> %s\n'

# Qt and its fonts: without a font every label is blank.
DEBIAN_RUN := python3-venv libegl1 libgl1 libxkbcommon0 libdbus-1-3 libfontconfig1 fonts-dejavu-core \
  libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-keysyms1 libxcb-image0 libxcb-render-util0 libxcb-shape0
DEBIAN_FIRMWARE := gcc g++ make gcc-avr avr-libc libsimavr-dev libelf-dev \
  gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
DEBIAN_TEST := $(DEBIAN_RUN) $(DEBIAN_FIRMWARE) hdf5-tools mbpoll arduino-core-avr avrdude

.DEFAULT_GOAL := help
.PHONY: help setup boards demo gui test check pytest firmware kernels exchange bench orders realtime identify invariance skin scale shots soak soak-plan soak-kills faults fuzz scans attack docs site docs-numbers lock wheels clean

help:
	@sed -n 's/^#   //p' Makefile
	@echo 'also: make gui, check, firmware, exchange, bench, orders, realtime, identify, invariance, skin, scale, shots, soak, faults, fuzz, scans, attack, docs, site, docs-numbers, lock, wheels, clean'

$(VENV)/.ready: requirements.lock pyproject.toml hatch_build.py
	$(SAY) "Python environment in $(VENV) (locked versions, hashes checked, wheels only)"
	@sh .ci/debian-packages python3-venv g++
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "rigctl needs Python 3.11 or newer; run: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/pip install --quiet --disable-pip-version-check --only-binary :all: --require-hashes -r requirements.lock
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

setup: $(VENV)/.ready

# The firmware's sources may have changed since the installation compiled them.
boards: $(VENV)/.ready
	@$(BIN)/python -m rigctl.host_build

demo: boards
	@sh .ci/debian-packages $(DEBIAN_RUN)
	$(SAY) "acquire, verify, encode and classify on the virtual rig"
	@$(BIN)/rigctl demo $(DEMO_ARGS)

gui: boards
	@sh .ci/debian-packages $(DEBIAN_RUN)
	@$(BIN)/rigctl gui

test: check pytest

check: $(VENV)/.ready
	$(SAY) "style, types, import floors"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python -m rigctl.boards.codegen --check
	@$(BIN)/python -m rigctl.finger.neuron_header --check

firmware: $(VENV)/.ready
	@sh .ci/debian-packages $(DEBIAN_FIRMWARE)
	$(SAY) "firmware of all boards, and the simulated chips"
	@$(MAKE) --no-print-directory -C arduino PYTHON=$(abspath $(BIN)/python)

kernels: boards
	$(SAY) "compiled kernels of simulation and encoder"
	@$(BIN)/python -m tests.kernels

# Byte code is kept whatever the environment says: a test starts programs, and each would compile
# all that it imports.
pytest: $(VENV)/.ready
	@$(MAKE) --no-print-directory -j 2 firmware kernels
	@sh .ci/debian-packages $(DEBIAN_TEST)
	$(SAY) "test suite, four workers: many tests wait for boards that run in real time"
	@PYTHONDONTWRITEBYTECODE= QT_QPA_PLATFORM=offscreen OPENBLAS_NUM_THREADS=1 \
	  $(BIN)/python -m pytest -n 4 --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

$(PEERS)/.ready: tests/benchmarks/encoder/peers.txt
	$(SAY) "peers to measure against, in an environment of their own"
	@test -x $(PEERS)/bin/python || $(PYTHON) -m venv $(PEERS)
	@$(PEERS)/bin/pip install --quiet --disable-pip-version-check -r tests/benchmarks/encoder/peers.txt
	@touch $@

$(READERS)/.ready: tests/exchange/readers.txt
	$(SAY) "other people's readers of NWB, in an environment of their own"
	@test -x $(READERS)/bin/python || $(PYTHON) -m venv $(READERS)
	@$(READERS)/bin/pip install --quiet --disable-pip-version-check -r tests/exchange/readers.txt
	@touch $@

exchange: boards $(READERS)/.ready
	@sh .ci/debian-packages octave
	@$(BIN)/pip install --quiet --disable-pip-version-check nixio==1.5.4  # no wheels for all
	$(SAY) "exports, read by SpikeInterface, pynapple and Octave, and judged by nwbinspector"
	@RIGCTL_READERS_PYTHON=$(abspath $(READERS)/bin/python) OPENBLAS_NUM_THREADS=1 \
	  $(BIN)/python -m pytest -q -o python_files="*_exchange.py test_formats.py test_bad_targets.py" \
	  tests/exchange

bench: firmware $(PEERS)/.ready
	@sh .ci/debian-packages $(DEBIAN_TEST)
	$(SAY) "every figure with its peer in the same run; also in build/bench.jsonl"
	@PYTHONDONTWRITEBYTECODE= QT_QPA_PLATFORM=offscreen RIGCTL_PEERS_PYTHON=$(abspath $(PEERS)/bin/python) \
	  $(BIN)/python -m tests.benchmarks $(BENCH_ARGS)

scale: boards
	$(SAY) "what 10⁶ and 10⁸ trials would cost, from rates measured now: docs/explanation/scale.md"
	@$(BIN)/python -m tests.benchmarks.encoder.scale docs/explanation/scale.md

# Independent virtual sets; what is there already is used again.
# WORLD=FILE gives them another simulated bench.
ORDERS := build/orders$(if $(WORLD),-$(basename $(notdir $(WORLD))))
SEEDS ?= 1 2 3
REPEATS ?= 10

orders: boards
	$(SAY) "virtual sets of seeds $(SEEDS), $(REPEATS) repeats, and which comparisons of Table 1 hold in each"
	@mkdir -p $(ORDERS)
	@for seed in $(SEEDS); do \
	  name=$(REPEATS)-seed-$$seed; \
	  test -d $(ORDERS)/$$name && continue; \
	  test -d $(ORDERS)/set-$$name || $(BIN)/rigctl synth --plan protocols/paper.toml \
	    $(if $(WORLD),--world $(WORLD)) --repeats $(REPEATS) --seed $$seed \
	    --out $(ORDERS)/set-$$name || exit $$?; \
	  $(BIN)/rigctl analyse $(ORDERS)/set-$$name \
	    --out $(ORDERS)/$$name $(ORDERS_ARGS) || exit $$?; \
	done
	@rm -rf $(ORDERS)/page
	@$(BIN)/rigctl orders $(SEEDS:%=$(ORDERS)/$(REPEATS)-seed-%) --out $(ORDERS)/page

# Data sets of the moving finger, a training session and a later one each.
FINGER := build/finger

realtime: boards
	$(SAY) "the paper's real-time experiment with the virtual finger, seeds $(SEEDS), and its figures"
	@mkdir -p $(FINGER)
	@for seed in $(SEEDS); do \
	  set=$(FINGER)/seed-$$seed; options="--rig virtual --seed $$seed --yes"; \
	  test -d $$set/train || $(BIN)/rigctl realtime train $$options --out $$set/train || exit $$?; \
	  test -d $$set/calibrate || $(BIN)/rigctl realtime calibrate $$options \
	    --model $$set/train --out $$set/calibrate || exit $$?; \
	  test -d $$set/run || $(BIN)/rigctl realtime run $$options \
	    --model $$set/calibrate --out $$set/run || exit $$?; \
	done
	@rm -rf $(FINGER)/report
	@$(BIN)/rigctl analyse --experiment realtime \
	  $(foreach seed,$(SEEDS),$(FINGER)/seed-$(seed)/train $(FINGER)/seed-$(seed)/calibrate \
	    $(FINGER)/seed-$(seed)/run) --out $(FINGER)/report

identify: $(VENV)/.ready
	$(SAY) "the bench's unknowns, searched for by the paper's Original column and real skins (half an hour)"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.identify_bench $(IDENTIFY_ARGS)

invariance: $(VENV)/.ready
	$(SAY) "the tables of docs/explanation/force-invariance.md (four minutes)"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.force_invariance $(INVARIANCE_ARGS)

skin: $(VENV)/.ready
	$(SAY) "the tables of docs/explanation/real-and-simulated.md (a quarter of an hour)"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.skin_statistics $(SKIN_ARGS)

# Results that pages tell, but for those of the finger, which `make realtime` makes.
NUMBERS ?= ra-rates textbook processors ranges invariance distances mountings spreads

docs-numbers: boards
	$(SAY) "results that pages of docs tell, measured again where build/numbers lacks them: $(NUMBERS)"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.docs_numbers $(NUMBERS)

# A scan whose velocity and answer change.
SHOWN_SCAN ?= 17

shots: boards
	@sh .ci/debian-packages $(DEBIAN_RUN)
	$(SAY) "every page of the window in two themes and three sizes, and a film: build/shots (eight minutes)"
	@rm -rf build/shots
	@QT_QPA_PLATFORM=offscreen $(BIN)/python -m tools.screenshots build/shots
	$(SAY) "a scan of the moving finger, from a quick experiment with the virtual finger"
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	  $(BIN)/python -m rigctl realtime demo --out "$$folder/demo" && \
	  for kind in png gif; do \
	    $(BIN)/python -m rigctl realtime movie "$$folder/demo/run" --trial $(SHOWN_SCAN) \
	      --out "$$folder/finger-scan.$$kind" && mv "$$folder/finger-scan.$$kind" docs/images/ || exit 1; \
	  done

# Faults and kills in the whole plan beside kills in real time: each has a processor. The same command
# goes on after an interruption; rm -r build/soak begins anew.
soak: firmware
	$(SAY) "24,000 trials with faults and kills, and 300 kills in real time: docs/reference/soak.md"
	@$(MAKE) --no-print-directory -j 2 soak-plan soak-kills
	$(SAY) "an hour of world time on virtual boards, ten minutes on the chips"
	@$(BIN)/python -m pytest -q -o python_files="soak_*.py" tests/soak/soak_hour.py
	$(SAY) "an hour of streaming into the window and onto the disk: memory, redraw, latency"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -s -o python_files="soak_*.py" tests/soak/soak_live.py

soak-plan: boards
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.endurance docs/reference/soak.md

soak-kills: boards
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.endurance.kills build/soak/kills docs/reference/soak.md

faults: boards
	$(SAY) "every fault in every state: docs/reference/faults.md (five minutes)"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.endurance.matrix docs/reference/faults.md

# FUZZ_SEED=… has the same mutations again; FUZZ_FILES (of each kind), FUZZ_REQUESTS, FUZZ_SECONDS.
FUZZER := build/fuzz/atheris

fuzz: firmware
	$(SAY) "both wires under a million corrupted bytes, both engines under 200,000 mutated requests"
	@$(BIN)/python -m pytest -q -o python_files="soak_*.py" \
	  $(wildcard tests/soak/soak_wires.py tests/soak/soak_decoders.py tests/soak/soak_requests.py)
	@$(BIN)/pip install --quiet --disable-pip-version-check --upgrade --require-hashes --no-deps \
	  --only-binary :all: --target $(FUZZER) -r tests/fuzz/requirements.txt \
	  || echo "atheris has no wheel for this computer: no guided mutations"
	$(SAY) "5,000 mutated files of each kind, guided texts, and requests during runs (half an hour)"
	@PYTHONPATH=$(FUZZER) OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz

scans: firmware
	$(SAY) "500 scans of the moving finger: the Cortex-M7 image, the host build and the encoder, spike by spike"
	@$(BIN)/python -m pytest -q -o python_files="soak_*.py" tests/soak/soak_scans.py

# Another seed each time, printed at the end: ATTACK_SEED=… has the same attacks again.
ATTACK_SEED ?= $(shell date +%s)
ATTACKS ?= 100000
CHIP_ATTACKS ?= 2000
CHIP_WIRE_ATTACKS ?= 500
# More than there are.
WIRE_PAIRS ?= 10000

attack: firmware
	$(SAY) "$(ATTACKS) attacks on the drum's virtual board, the worst of them and others on its chip"
	@RIGCTL_ATTACK_SEED=$(ATTACK_SEED) RIGCTL_ATTACKS=$(ATTACKS) RIGCTL_CHIP_ATTACKS=$(CHIP_ATTACKS) \
	  RIGCTL_WIRE_ATTACKS=$(ATTACKS) RIGCTL_CHIP_WIRE_ATTACKS=$(CHIP_WIRE_ATTACKS) \
	  RIGCTL_WIRE_PAIRS=$(WIRE_PAIRS) \
	  $(BIN)/python -m pytest -q tests/attack

docs: firmware
	$(SAY) "pages and pictures that are rendered from the code"
	@$(BIN)/python -m rigctl.boards.codegen
	@$(BIN)/python -m rigctl.finger.neuron_header
	@$(BIN)/python -m rigctl.bench.parameter_tables
	@$(BIN)/python -m rigctl.finger.bench.operator_parameters
	@$(BIN)/python -m tests.engine.setup.wrong_wirings > docs/reference/wrong-wirings.md
	@$(BIN)/python -m tests.architecture.picture
	@$(BIN)/python arduino/wiring.py
	@$(BIN)/python arduino/mechanics.py
	@$(MAKE) --no-print-directory site

# Each page is read anew: a warning of a page that did not change would not come again.
site: $(VENV)/.ready
	$(SAY) "the documentation as a site: build/site/docs/README.html"
	@rm -rf build/site
	@$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --fresh-env \
	  --conf-dir docs --doctree-dir build/site-doctrees . build/site

lock:
	@$(BIN)/pip install --quiet uv
	@$(BIN)/uv pip compile pyproject.toml --extra test --universal --python-version 3.11 \
	  --no-header --quiet --generate-hashes --upgrade -o requirements.lock

# A wheel for each system; Zig compiles the virtual boards for it, avr-gcc the images.
WHEELS := .wheels
PLATFORMS ?= manylinux_2_17_x86_64 manylinux_2_17_aarch64 win_amd64 macosx_11_0_x86_64 macosx_11_0_arm64

$(WHEELS)/.ready: tools/wheels.txt
	@test -x $(WHEELS)/bin/python || $(PYTHON) -m venv $(WHEELS)
	@$(WHEELS)/bin/pip install --quiet --disable-pip-version-check -r tools/wheels.txt
	@touch $@

wheels: boards site $(WHEELS)/.ready
	@sh .ci/debian-packages $(DEBIAN_FIRMWARE) \
	  $(if $(filter x86_64,$(shell uname -m)),wine64 qemu-user libc6-arm64-cross)
	$(SAY) "wheels of $(PLATFORMS) in dist/"
	@rm -rf dist build/wheels/tmp*
	@for platform in $(PLATFORMS); do \
	  RIGCTL_PLATFORM=$$platform $(WHEELS)/bin/python -m hatchling build -t wheel -d dist || exit $$?; \
	done
	@for wheel in dist/*linux*.whl; do $(WHEELS)/bin/auditwheel show $$wheel || exit $$?; done
	@$(WHEELS)/bin/python -m tools.check_wheels dist
	$(SAY) "uv tool install of this computer's wheel, outside the checkout"
	@cd /tmp && export UV_TOOL_DIR=$(CURDIR)/build/tool UV_TOOL_BIN_DIR=$(CURDIR)/build/tool/bin && \
	  $(CURDIR)/$(WHEELS)/bin/uv tool install --quiet --force $(CURDIR)/dist/*manylinux*_$$(uname -m).whl && \
	  $(CURDIR)/build/tool/bin/rigctl --version && rm -rf $(CURDIR)/build/tool

clean:
	rm -rf build dist $(VENV) $(PEERS) $(READERS) $(WHEELS)
