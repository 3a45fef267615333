# The project's commands; `make help` lists them.
PYTHON ?= /usr/bin/python3
CAMPAIGN ?= campaign/demo.toml
VENVS = .venvs
#: What `make style` runs; fixed versions, since a newer one may find more.
STYLE = ruff==0.17.6 mypy==2.4.1 codespell==2.4.3 numpy==2.4.6
#: What `make docs` runs.
PDOC = pdoc==16.0.0
ANALYSIS = python3-h5py python3-pandas python3-scipy python3-matplotlib
DEBIAN = yade $(ANALYSIS) python3-pytest
#: What the tests of explore.html need: a browser with its driver, and plotly, which writes the page.
BROWSER = chromium chromium-driver python3-selenium python3-plotly
#: Paths that the Debian packages above put in place: all there, nothing to install.
MODULES = $(addprefix /usr/lib/python3/dist-packages/,h5py pandas scipy matplotlib)
INSTALLED = /usr/bin/yade $(MODULES) /usr/lib/python3/dist-packages/pytest

NO_APT = This system has no apt-get. Debian 12 or newer and Ubuntu have all packages, YADE included. With conda, pip or macOS, \
  \`pip install .\` gives plan, analyse, report, compare and export; runs are made on a cluster or in a container (Dockerfile).

.PHONY: help setup lammps campaign laptop laptop-data report test test-long test-newest test-browser docs style bench-dem stress slurm-test clean
.DEFAULT_GOAL := help

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 14

setup: ## install what is missing (Debian's yade and Python packages; root or sudo)
	@ls -d $(INSTALLED) >/dev/null 2>&1 || $(call apt_install,$(DEBIAN))

lammps: ## install LAMMPS, for campaigns with dem.code = "lammps" (Debian's lammps; root or sudo)
	@command -v lmp >/dev/null || $(call apt_install,lammps)

campaign: setup ## run the default campaign, from the measured pairs to the report (CAMPAIGN=FILE for another)
	@$(PYTHON) -m campaign all $(CAMPAIGN)

laptop: setup ## the paper's campaign at reduced size; hours, can be stopped and taken up again
	@$(PYTHON) -m campaign all campaign/laptop.toml

laptop-data: setup ## the laptop campaign from where data/laptop left it, its results, figures and report into data/laptop
	@$(PYTHON) data/make_laptop.py

report: ## every table and figure and the report from data/laptop/results.h5; a minute, no YADE
	@ls -d $(MODULES) >/dev/null 2>&1 || $(call apt_install,$(ANALYSIS))
	@$(PYTHON) -m campaign report

test: setup ## the tests, YADE included; those of campaign/ and yade/ in a second process at the same time
	@log=$$(mktemp); $(PYTHON) -m pytest -q tests/campaign tests/yade >$$log 2>&1 & second=$$!; \
	  $(PYTHON) -m pytest -q --ignore=tests/campaign --ignore=tests/yade; code=$$?; \
	  wait $$second || code=1; cat $$log; rm -f $$log; exit $$code

test-long: setup ## the tests that take minutes
	@$(PYTHON) -m pytest -q -m long

test-newest: setup ## the analysis and its tests on the newest numpy, scipy, pandas, h5py and matplotlib from PyPI
	@[ -x $(VENVS)/newest/bin/pytest ] || { $(call new_venv,newest) && \
	  $(VENVS)/newest/bin/pip install -q numpy scipy pandas h5py matplotlib pytest; }
	@$(VENVS)/newest/bin/python -c "import numpy, scipy, pandas, h5py, matplotlib as m; \
	  print(*(f'{p.__name__} {p.__version__}' for p in (numpy, scipy, pandas, h5py, m)), sep=', ')"
	@$(VENVS)/newest/bin/python -m pytest -q -m "not long and not yade and not browser"

test-browser: setup ## the tests of explore.html in headless Chromium
	@ls -d /usr/bin/chromedriver /usr/lib/python3/dist-packages/selenium /usr/lib/python3/dist-packages/plotly >/dev/null 2>&1 || \
	  $(call apt_install,$(BROWSER))
	@$(PYTHON) -m pytest -q -m browser

docs: ## the API page from the docstrings, in build/api (pdoc from PyPI)
	@ls -d $(MODULES) >/dev/null 2>&1 || $(call apt_install,$(ANALYSIS))
	@[ -x $(VENVS)/docs/bin/pdoc ] || { $(call new_venv,docs,--system-site-packages) && $(VENVS)/docs/bin/pip install -q $(PDOC); }
	@MPLBACKEND=Agg $(VENVS)/docs/bin/python tests/support/api_pages.py build/api
	@echo "docs: build/api/analysis.html"

style: ## lint, format, type hints and spelling (settings in pyproject.toml)
	@[ -x $(VENVS)/style/bin/mypy ] && [ -x $(VENVS)/style/bin/codespell ] || { $(call new_venv,style) && \
	  $(VENVS)/style/bin/pip install -q $(STYLE); }
	@$(VENVS)/style/bin/ruff check -q .
	@$(VENVS)/style/bin/ruff format -q --check .
	@$(VENVS)/style/bin/mypy
	@$(VENVS)/style/bin/codespell
	@echo "style: lint, format, type hints and spelling are good"

bench-dem: setup ## the DEM protocol's run time against error; resumable, writes data/benchmarks
	@$(PYTHON) tests/benchmarks/bench_dem.py

stress: setup ## the stability map of the DEM protocol; writes data/benchmarks
	@$(PYTHON) tests/benchmarks/bench_stability.py

slurm-test: setup ## the default campaign through a real one-node SLURM from Debian's packages (root; CAMPAIGN=: nine short runs)
	@sh tests/support/slurm_node.sh env SLURM_TEST_CAMPAIGN=$(CAMPAIGN) $(PYTHON) -m pytest -q -m long tests/campaign/test_engine_slurm.py

clean: ## remove caches and virtual environments (never runs/)
	@rm -rf $(VENVS) .pytest_cache .ruff_cache build
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A virtual environment of that name, with Debian's python3-venv installed where it is missing.
define new_venv
{ $(PYTHON) -m venv $(2) $(VENVS)/$(1) >/dev/null 2>&1 || { rm -rf $(VENVS)/$(1); $(call apt_install,python3-venv) && \
  $(PYTHON) -m venv $(2) $(VENVS)/$(1); }; }
endef

define apt_install
{ command -v apt-get >/dev/null || { echo "$(NO_APT)" >&2; exit 1; }; \
  as_root=$$([ "$$(id -u)" = 0 ] || echo sudo); echo "installing: $(1)"; $$as_root apt-get -qq update && \
  $$as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $(1) </dev/null; }
endef
