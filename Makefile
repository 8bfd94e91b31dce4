# Everything runs in .venv, which the first target that needs it makes. A stamp per set of packages: installed once, and
# again when one of SETTINGS changes.
# Blender as a module exists for Python 3.11 (4.2 to 5.0) and 3.13 (from 5.1 on).
PYTHON ?= $(firstword $(foreach version,python3.11 python3.13,$(if $(shell $(version) -c 0 2> /dev/null && echo yes),$(version))) python3.11)
VENV := .venv
# A virtual environment looks different on Windows.
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
VENV_PYTHON := $(BIN)/python$(if $(filter Windows_NT,$(OS)),.exe)
OUT ?= out/wave
SETTINGS := pyproject.toml setup.py blender_manifest.toml
# Which torch: `cpu`, or `gpu` where an NVIDIA GPU is found, or on request: make demo TORCH=gpu. The default package index has
# torch for Linux with CUDA's libraries, gigabytes of them; CPU_TORCH is the address of PyTorch's index without them.
TORCH ?= $(if $(shell nvidia-smi -L 2> /dev/null),gpu,cpu)
CPU_TORCH ?=
BPY_WANTED := bpy>=4.2
TORCH_WANTED := $(shell sed -n 's/^ *"\(torch[<>=][^"]*\)".*/\1/p' pyproject.toml)
# The other versions of Blender that have a module: for Python 3.11, and for 3.13 where that is installed.
OTHER_BLENDERS := 4.2 5.0 $(if $(shell python3.13 -c 0 2> /dev/null && echo yes),5.2 5.3)
# A demo with another avatar: make demo AVATAR=deep, or AVATAR=my.safetensors
AVATAR ?=
# Test processes; each takes whole files of tests. 0: all in one process, for a debugger.
JOBS ?= 2
SHARED := -n $(JOBS) --dist loadfile
KILLS ?= 200
# A Blender program for `make test-gui`, with torch in its Python.
BLENDER ?= blender

.PHONY: demo test test-fast test-nightly fuzz kills test-cuda gates test-gui test-matrix check results benchmark claims film docs zip release clean

demo: $(VENV)/demo.stamp
	$(BIN)/livehand render examples/wave.blend -o $(OUT) --format exr,png $(if $(AVATAR),--avatar $(AVATAR))
	@$(BIN)/livehand sheet $(OUT) > /dev/null
	@echo "Look at $(OUT)/contact_sheet.png; the frames lie beside it: wave_0001.png and wave_0001.exr (Combined, Depth) to 0024."

# One torch thread a process: two processes of two threads wait for each other on two cores (8.2 instead of 1.9 processor minutes
# for the tests of rigs and persons).
test test-fast test-nightly: export OMP_NUM_THREADS := 1
# Without bytecode each of some hundred processes compiles all our modules, and rewrites the assertions of all tests.
unexport PYTHONDONTWRITEBYTECODE

test: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m pytest -q $(SHARED) --durations=10

# What takes half a minute or more, and says what `make test` says by a smaller case. A GitHub workflow runs it every night.
test-nightly: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m pytest -q $(SHARED) -m nightly --durations=10

# Files changed at random, for every reader; the tests do a share of it. Another FIRST gives other files.
MINUTES ?= 10
FIRST ?= $(shell date +%s)
fuzz: $(VENV)/dev.stamp
	$(VENV_PYTHON) tests/fuzz/run.py --seconds $$(( $(MINUTES) * 60 )) --first $(FIRST)

# Commands killed at random moments, and repeated until they are done; the tests do a share of it.
kills: $(VENV)/dev.stamp
	$(VENV_PYTHON) tests/kills/run.py --kills $(KILLS)

# The daily loop: no Blender, nothing that is fitted or slow.
test-fast: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m pytest -q $(SHARED) -m "not slow and not nightly" tests \
		$(addprefix --ignore=tests/,blender gui compute/gpu training research/benchmark research/baselines research/comparison fuzz kills)

# Fails without a GPU, so that nothing skipped is taken for passed. REHEARSE=1: on the CPU, to see that the tests run.
REHEARSE ?=
test-cuda: $(VENV)/dev.stamp
	@$(if $(REHEARSE),true ||) $(VENV_PYTHON) -c 'import sys, torch; sys.exit(None if torch.cuda.is_available() else "make test-cuda needs a CUDA GPU and a CUDA build of torch")'
	$(if $(REHEARSE),LIVEHAND_REHEARSE=1) $(VENV_PYTHON) -m pytest -q tests/test_cuda.py tests/compute/gpu

# The day there is a GPU: all that is asked of it, within 9 minutes, in lines and in out/gpu_gates.json. REHEARSE=1 as above.
gates: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m livehand.tools.gpu_gates $(if $(REHEARSE),--rehearse)

# The Blender tests in each of the other versions; all are run, then it fails if one did.
test-matrix: $(OTHER_BLENDERS:%=.venv-bpy%/test.stamp)
	@failed=; for version in $(OTHER_BLENDERS); do \
		echo "Blender $$version"; \
		.venv-bpy$$version/bin/python -m pytest -q $(SHARED) -m "" tests/blender || failed="$$failed $$version"; \
	done; test -z "$$failed" || { echo "Failed in Blender$$failed" >&2; exit 1; }

# A real window, in a virtual X screen. Also needs Xvfb, xdotool and ImageMagick; takes minutes. Screenshots: out/gui.
test-gui:
	python3 tests/gui/run.py --blender $(BLENDER)

check: $(VENV)/dev.stamp
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/pyright --pythonpath $(VENV_PYTHON)

# The tables of docs/results and README, from docs/results/data. The avatars' figures are read from their headers first.
results: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m livehand.tools.results.collect avatars
	$(VENV_PYTHON) -m livehand.tools.results.write

# The benchmark of docs/results/speed.md, on this machine, and its tables; a quarter of an hour.
BENCHMARK ?= --frames 16 --budget 20 --cycles-frames 3 --sizes 334x512,1080p --paper-sizes 334x512
benchmark: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m livehand.tools.results.collect benchmark $(BENCHMARK)
	$(VENV_PYTHON) -m livehand.tools.results.write

# Every figure of README and docs/results that a command gives, measured again; a drift of more than 5 % fails. What cannot
# be measured here is listed (STRICT=1: fails, too). A quarter of an hour; run it before a release.
claims: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m livehand.tools.results.claims $(if $(STRICT),--strict)

# Two minutes of what LiveHand does, in out/film.mp4: an hour on two cores, the better part of it Cycles'. It goes on where it was
# stopped. Needs the hand tracker (livehand fetch-tracker).
FILM ?=
film: $(VENV)/dev.stamp
	$(VENV_PYTHON) -m livehand.tools.film.make out/film.mp4 $(FILM)

# The pages of docs/ as a site, in out/site; a warning is an error.
docs: $(VENV)/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# The zip without wheels, which Install Packages completes in Blender.
zip: $(VENV)/release.stamp
	$(VENV_PYTHON) -m livehand.tools.release.build --out dist $(RELEASE) --only

# GPU_CHIPS=7.5,8.6,8.9,9.0,12.0: kernels of NVIDIA's GPUs are compiled ahead into the zips, by Warp; most of a minute and 0.6 MB a chip.
GPU_CHIPS ?=
# Zips with all packages for Windows, macOS and Linux, each for two Pythons, and the repository that lists them, in
# dist/release; the one for this system and Python is installed, and a frame rendered. WEBSITE goes into the manifests.
WEBSITE ?=
RELEASE := $(if $(WEBSITE),--website $(WEBSITE)) $(if $(CPU_TORCH),--cpu-torch $(CPU_TORCH)) $(if $(GPU_CHIPS),--gpu $(GPU_CHIPS))
# If the zips will not lie beside the page that lists them: where they will, and where that will.
ZIPS_URL ?=
PAGE_URL ?=
OURS = $(wildcard dist/release/repository/*linux_x64-py$(shell $(VENV_PYTHON) -c 'import sys; print("%d%d" % sys.version_info[:2])').zip)
release: $(VENV)/release.stamp
	$(VENV_PYTHON) -m livehand.tools.release.build --out dist/release $(RELEASE) \
		$(if $(ZIPS_URL),--zips-url $(ZIPS_URL) --page-url $(PAGE_URL))
	$(if $(filter Linux,$(shell uname -s)),$(VENV_PYTHON) -m livehand.tools.release.try_zip $(OURS) --image dist/release/frame.png)

clean:
	rm -rf $(VENV) .venv-bpy* out dist build *.egg-info .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A no-op where torch is installed already. If the index cannot be reached, the next step takes the default one's build.
define install_torch
	@$(if $(filter cpuLinux,$(TORCH)$(shell uname -s)),$(if $(CPU_TORCH),echo "No NVIDIA GPU found: torch for CPUs"; \
		$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet --retries 0 --timeout 15 --index-url $(CPU_TORCH) '$(TORCH_WANTED)' \
		|| echo "$(CPU_TORCH) cannot be used; taking torch with CUDA",echo "No NVIDIA GPU found: make CPU_TORCH=ADDRESS (PyTorch's index for CPUs) saves gigabytes"))
endef

$(VENV)/demo.stamp: $(VENV_PYTHON) $(SETTINGS)
	@echo "Installing Blender as a module, torch and LiveHand into $(VENV); once, 2 GB"
	$(install_torch)
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet -e '.[bpy]'
	@touch $@

# Blender as a module for its extension tool, and nothing that renders.
$(VENV)/release.stamp: $(VENV_PYTHON) $(SETTINGS)
	@echo "Installing Blender as a module into $(VENV); once"
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet --no-deps -e .
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet packaging '$(BPY_WANTED)'
	@touch $@

$(VENV)/dev.stamp: $(VENV_PYTHON) $(SETTINGS)
	@echo "Installing what checks and tests need into $(VENV); once"
	$(install_torch)
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet -e '.[dev]'
	@touch $@ $(VENV)/demo.stamp

$(VENV)/docs.stamp: $(VENV_PYTHON) $(SETTINGS)
	@echo "Installing what the docs' site needs into $(VENV); once"
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet -e '.[docs]'
	@touch $@

# Not `dev`: that extra asks for the one version of Blender that all else runs in.
.venv-bpy%/test.stamp: $(VENV_PYTHON) $(SETTINGS)
	@echo "Installing Blender $* and what tests need into .venv-bpy$*; once"
	$(if $(filter 4.% 5.0,$*),$(VENV_PYTHON),python3.13) -m venv --clear .venv-bpy$*
	.venv-bpy$*/bin/python -m pip install --disable-pip-version-check --quiet -e '.[test]' 'bpy==$*.*'
	@touch $@

$(VENV_PYTHON):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' 2> /dev/null || { echo "$(PYTHON) will not do: Blender as a module needs Python 3.11 (or 3.13). Install python3.11, or name one: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || { echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt install python3.11-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
