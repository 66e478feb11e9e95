# make demo    install everything and composite the samples: samples/out.mp4 and samples/report/
# make test    install everything and run all tests
# make native  compile the C++ kernels into the checkout again, after a change
# make sanitize  the tests of the C++ kernels under the sanitizers of the compiler
# make adapters  the tests of GStreamer, VapourSynth and Blender, with those programs installed
# make hosts   install those programs alone
# make vapoursynth  the tests of VapourSynth alone
# make check   format check, lint, types and the quick tests, in a few minutes
# make lint    format check, lint, types
# make fuzz    damaged files of every kind by the hundred thousand, a hundred killed runs: docs/faults.md
# make gallery  the pictures of docs/gallery
# make hard    docs/hard.md and its pictures: every case of tests/hard
# make docs    the documentation as a site: site/index.html
# make golden  are the results the bits they were: eight runs, twenty with the ground truth
# make addon   the add-on for Blender, to install there: dist/nlens_video_blender.zip
# make bench   time of each node of the demo, and its ratio to plain decode + encode

PYTHON ?= python3
VENV   ?= .venv
DIST   ?= dist
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check -q
NODE_PACKAGES := tests/studio/node_modules/.package-lock.json
SOURCES := $(wildcard pyproject.toml constraints.txt hatch_build.py nlens_video/core/version.py nlens_video/native/CMakeLists.txt nlens_video/native/source/*)

# Debian and Ubuntu packages: headless OpenGL, what compiles the kernels, and venv where Python comes
# without it.
define SYSTEM
missing=""; \
$(FIND_SYSTEM) \
$(INSTALL_MISSING)
endef

# Those of the programs that the tests run, and of the pictures and sounds that GStreamer makes.
# Chromium may be Google's, or have the name that other systems give it; npm fetches NODE_PACKAGES.
define PROGRAMS
missing=""; \
command -v ffmpeg >/dev/null && command -v ffprobe >/dev/null || missing="$$missing ffmpeg"; \
command -v gst-launch-1.0 >/dev/null || missing="$$missing gstreamer1.0-tools"; \
gst-inspect-1.0 --exists videotestsrc 2>/dev/null || missing="$$missing gstreamer1.0-plugins-base"; \
gst-inspect-1.0 --exists y4menc 2>/dev/null || missing="$$missing gstreamer1.0-plugins-good"; \
command -v gst-launch-1.0 >/dev/null && [ -e /usr/lib/*/gstreamer-1.0/libgstpython.so ] || missing="$$missing gstreamer1.0-python3-plugin-loader python3-gst-1.0 gir1.2-gst-plugins-base-1.0"; \
command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || missing="$$missing chromium"; \
command -v npm >/dev/null || missing="$$missing npm"; \
$(INSTALL_MISSING)
endef

# ldconfig lies in /sbin, which is not on the PATH of an ordinary user of Debian.
define FIND_SYSTEM
PATH="$$PATH:/usr/sbin:/sbin"; \
ldconfig -p 2>/dev/null | grep -q 'libEGL\.so\.1' || missing="$$missing libegl1"; \
ldconfig -p 2>/dev/null | grep -q 'libGL\.so\.1' || missing="$$missing libgl1"; \
$(PYTHON) -c 'import ensurepip' 2>/dev/null || missing="$$missing python3-venv"; \
command -v c++ >/dev/null || missing="$$missing g++"; \
$(PYTHON) -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' || missing="$$missing python3-dev";
endef

define INSTALL_MISSING
if [ -n "$$missing" ]; then \
  if ! command -v apt-get >/dev/null; then echo "Missing here. Install what your system calls:$$missing" >&2; exit 1; fi; \
  if [ "$$(id -u)" = 0 ]; then sudo=""; elif sudo -n true 2>/dev/null; then sudo="sudo"; else echo "Missing here, and no right to install it. Ask for: apt-get install$$missing" >&2; exit 1; fi; \
  echo "Installing$$missing"; \
  $$sudo apt-get -o Acquire::Retries=3 update -qq && $$sudo env DEBIAN_FRONTEND=noninteractive apt-get -o Acquire::Retries=3 install -y -qq --no-install-recommends $$missing >/dev/null || exit 1; \
fi
endef

# apt-get does not run twice at once.
.NOTPARALLEL:

.PHONY: adapters hosts vapoursynth native sanitize demo test check lint fuzz gallery hard docs golden addon bench install system programs clean

system:
	@$(SYSTEM)

programs:
	@$(PROGRAMS)
	@$(MAKE) -s $(NODE_PACKAGES)

# The compiler that checks the types of the studio's page, and axe-core; their tests are skipped
# without them, and fail where REQUIRE_NODE_PACKAGES=1, as in .ci/run.
$(NODE_PACKAGES): tests/studio/package-lock.json
	@echo "Installing the packages of tests/studio/package.json"
	@npm ci --prefix tests/studio --ignore-scripts --no-audit --no-fund --loglevel=error --fetch-retries=1 --fetch-timeout=60000 \
	  && touch $@ || echo "npm cannot install them; the page's types and its accessibility stay untested here" >&2

$(BIN)/python: | system
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed, $(PYTHON) is $$($(PYTHON) -V). Give another: make PYTHON=python3.12 …" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(SOURCES) | $(BIN)/python
	@echo "Installing into $(VENV)"
	@$(PIP) install -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-test: $(SOURCES) | $(BIN)/python
	@echo "Installing into $(VENV), with what the tests need"
	@$(PIP) install -c constraints.txt -e '.[train,test]'
	@touch $(VENV)/.installed $@

install: system $(VENV)/.installed

native: $(VENV)/.installed-test
	$(BIN)/python hatch_build.py

# The kernels with the compiler's address and undefined-behaviour sanitizers, under their tests and
# the damaged files; then as they were.
sanitize: $(VENV)/.installed-test
	$(BIN)/python hatch_build.py address,undefined
	LD_PRELOAD="$$(c++ -print-file-name=libasan.so) $$(c++ -print-file-name=libubsan.so)" ASAN_OPTIONS=detect_leaks=0 \
	  $(BIN)/python -m pytest -q -p no:cacheprovider tests/native tests/kernels tests/render tests/video/test_picture.py tests/hard/precision; \
	  found=$$?; $(BIN)/python hatch_build.py; exit $$found

demo: install
	$(BIN)/nlens-video samples/in.mp4 samples/anim.glb samples/out.mp4 --report samples/report -y
	@echo "Look at samples/out.mp4 and samples/report/index.html"
	@echo "The command is $(BIN)/nlens-video; to call it by its name: . $(BIN)/activate"

lint: system $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror nlens_video/native/source/*
	$(BIN)/mypy

check: programs lint
	REQUIRE_GL=1 REQUIRE_PROGRAMS=1 REQUIRE_CHROMIUM=1 $(BIN)/python -m pytest -q -n 2 -m "not slow"

# GStreamer's loader runs the system's Python, VapourSynth's wheels begin with 3.12, and each release
# of bpy has wheels for one Python alone: three environments. The other Pythons are the first that
# run, on the PATH or of pyenv.
define FIRST_PYTHON
$(shell for one in $(foreach minor,$(1),python3.$(minor) $${PYENV_ROOT:-$$HOME/.pyenv}/versions/3.$(minor)*/bin/python) $(PYTHON); do \
  "$$one" -c 'import sys; sys.exit(sys.version_info.minor not in tuple(map(int, "$(1)".split())))' 2>/dev/null && echo "$$one" && break; done)
endef
PYTHON_VAPOURSYNTH ?= $(call FIRST_PYTHON,12 13 14)
PYTHON_BPY ?= $(call FIRST_PYTHON,11 13)
HOSTS := blender python3-numpy xvfb gstreamer1.0-rtsp gstreamer1.0-nice gstreamer1.0-x gstreamer1.0-plugins-bad gstreamer1.0-plugins-ugly gir1.2-gst-rtsp-server-1.0 gir1.2-gst-plugins-bad-1.0 gstreamer1.0-pipewire pipewire wireplumber dbus

adapters: hosts $(VENV)/.installed-test
	REQUIRE_GL=1 REQUIRE_PROGRAMS=1 REQUIRE_GSTREAMER_PYTHON=1 REQUIRE_GSTREAMER_NETWORK=1 REQUIRE_BLENDER=1 REQUIRE_BPY=1 \
	  $(BIN)/python -m pytest -q tests/adapters --deselect tests/adapters/test_vapoursynth.py
	@$(MAKE) vapoursynth

vapoursynth: .venv-vapoursynth/.installed
	REQUIRE_GL=1 REQUIRE_PROGRAMS=1 REQUIRE_VAPOURSYNTH=1 .venv-vapoursynth/bin/python -m pytest -q tests/adapters/test_vapoursynth.py

hosts: programs
	@missing=""; for one in $(HOSTS); do dpkg-query -W -f '$${db:Status-Status}' $$one 2>/dev/null | grep -qx installed || missing="$$missing $$one"; done; $(INSTALL_MISSING)
	@$(MAKE) -s .venv-bpy/.installed .venv-vapoursynth/.installed

.venv-vapoursynth/.installed: $(SOURCES) | system
	@[ -n "$(PYTHON_VAPOURSYNTH)" ] || { echo "VapourSynth's wheels begin with Python 3.12, and none was found. Name one: make $(MAKECMDGOALS) PYTHON_VAPOURSYNTH=…" >&2; exit 1; }
	@echo "Installing VapourSynth into .venv-vapoursynth"
	@"$(PYTHON_VAPOURSYNTH)" -m venv .venv-vapoursynth
	@.venv-vapoursynth/bin/python -m pip --disable-pip-version-check -q install -c constraints.txt -e '.[vapoursynth]' pytest hypothesis
	@touch $@

.venv-bpy/.installed:
	@[ -n "$(PYTHON_BPY)" ] || { echo "bpy has wheels for Python 3.11 and 3.13, and neither was found. Name one: make $(MAKECMDGOALS) PYTHON_BPY=…" >&2; exit 1; }
	@echo "Installing bpy into .venv-bpy"
	@"$(PYTHON_BPY)" -m venv .venv-bpy
	@.venv-bpy/bin/python -m pip --disable-pip-version-check -q install bpy
	@touch $@

test: programs lint
	REQUIRE_GL=1 REQUIRE_TORCH=1 REQUIRE_PROGRAMS=1 REQUIRE_CHROMIUM=1 $(BIN)/python -m pytest -n 2

fuzz: system $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python -X faulthandler -W error -m hard.fuzz

gallery: install
	$(BIN)/python docs/make_gallery.py

docs: $(VENV)/.installed-test
	$(BIN)/python -m mkdocs build --strict --quiet
	@echo "Look at site/index.html"

hard: system $(VENV)/.installed-test
	$(BIN)/python docs/make_hard.py

bench: install
	OPENBLAS_NUM_THREADS=1 MALLOC_ARENA_MAX=1 MALLOC_MMAP_THRESHOLD_=33554432 MALLOC_TRIM_THRESHOLD_=33554432 $(BIN)/python benchmarks/bench_demo.py
	$(BIN)/python benchmarks/bench_scatter.py

addon:
	@rm -rf $(DIST)/nlens_video_blender.zip $(DIST)/addon && mkdir -p $(DIST)/addon
	@cp -r addons/blender/nlens_video_blender $(DIST)/addon/ && rm -rf $(DIST)/addon/nlens_video_blender/__pycache__
	@cp LICENSE $(DIST)/addon/nlens_video_blender/
	@cd $(DIST)/addon && $(PYTHON) -m zipfile -c ../nlens_video_blender.zip nlens_video_blender
	@rm -rf $(DIST)/addon
	@echo "Install it in Blender: Edit > Preferences > Add-ons > Install: $(DIST)/nlens_video_blender.zip"

golden: install
	$(BIN)/python benchmarks/golden.py

clean:
	rm -rf $(VENV) .venv-bpy .venv-vapoursynth tests/studio/node_modules build dist site samples/out.mp4 samples/report
