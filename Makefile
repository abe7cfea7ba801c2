# Every target works on a fresh clone: it needs python3 (3.11 or newer), cargo and a C linker.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?= python3
BIN := .venv/bin
# What has been done in .venv: the installer, few packages or all of them, the engine as a release.
UV := .venv/.uv
LIGHT := .venv/.light
TOOLS := .venv/.requirements
ENGINE := .venv/.engine
READY := $(TOOLS) $(ENGINE)

RUST_SOURCES := $(shell find drm_env -path drm_env/web -prune -o \( -name '*.rs' -o -name Cargo.toml \) -print 2>/dev/null) Cargo.toml $(wildcard Cargo.lock)

DEVELOP := VIRTUAL_ENV="$(CURDIR)/.venv" PATH="$(CURDIR)/$(BIN):$$PATH" maturin develop --uv
INSTALL_BASELINES := $(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps \
  --no-build-isolation --editable baselines

# One interpreter for every cargo call, or pyo3 would be compiled anew for each.
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python

.PHONY: help
help:
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: build
build: $(READY) ## the virtual environment .venv with everything in it

# few packages: the rest is in the way of nothing, and comes with the other targets
.PHONY: demo
demo: $(ENGINE) ## fly laws and policies that learned, and show the result (few packages)
	$(BIN)/drm demo

.PHONY: test
test: $(READY) ## all tests: the Rust engine, then Python's quick tests, then its slow ones
	cargo test --release --workspace
	$(BIN)/python -m pytest -n auto -m "not slow"
	$(BIN)/python -m pytest -n auto --dist loadfile -m slow --durations=5 -v

.PHONY: soak
soak: $(READY) ## what takes long: commands killed again and again, a hundred million steps, thousands of configurations
	$(BIN)/python tools/soak.py --kills 20 --steps 1e8
	DRM_PROFILE=soak $(BIN)/python -m pytest tests/test_properties.py tests/test_function_properties.py tests/test_fuzz_bindings.py -q
	DRM_FUZZ_CASES=20000 cargo test --release -p drm-env-web --test corpora
	@if cargo +nightly miri --version > /dev/null 2>&1; then $(MAKE) miri; else \
	  echo "no Miri here (rustup toolchain install nightly --component miri,rust-src): 'make miri' is left out"; fi
	@if tools/sanitize.sh --possible; then $(MAKE) sanitize; else echo "'make sanitize' is left out"; fi

# Unsafe code that an interpreter can run: what threads of a batch share, and what is watched over them.
.PHONY: miri
miri: # interpret the unsafe code that is no instruction of a processor (docs/reliability.md)
	MIRIFLAGS="-Zmiri-many-seeds=0..8" \
	  cargo +nightly miri test -p drm_env --lib -- batch::thread_pool interruption

# Unsafe code that no interpreter runs: vector instructions, arrays of the bindings, memory of a page.
.PHONY: sanitize
sanitize: $(READY) # the address sanitiser over it, which has to find faults on purpose first (docs/reliability.md)
	tools/sanitize.sh

# Needs cargo-fuzz (`cargo install cargo-fuzz`) and Atheris (`.venv/bin/uv pip install atheris`). libFuzzer's flags
# belong to nightly compilers: RUSTC_BOOTSTRAP lets the stable one take them.
FUZZ_SECONDS ?= 600
.PHONY: fuzz
fuzz: $(READY) ## feed engine and bindings with what libFuzzer makes up (docs/reliability.md)
	for door in configuration text snapshot network actions; do \
	  mkdir -p target/fuzz/found/$$door; \
	  CARGO_TARGET_DIR=target/fuzz RUSTC_BOOTSTRAP=1 cargo fuzz run --sanitizer none --codegen-units 64 --fuzz-dir drm_env/fuzz $$door \
	    target/fuzz/found/$$door drm_env/fuzz/corpus/$$door -- -max_total_time=$(FUZZ_SECONDS) \
	    -timeout=20 -rss_limit_mb=2048 -max_len=4096 -dict=drm_env/fuzz/dictionary.txt; \
	done
	for target in arrays files; do \
	  mkdir -p target/fuzz/found/$$target; \
	  $(BIN)/python tools/fuzz_bindings.py $$target target/fuzz/found/$$target tests/corpora/$$target \
	    -max_total_time=$(FUZZ_SECONDS) -timeout=20; \
	done

# Needs cargo-deny (`cargo install cargo-deny`); advisories are asked for over the network.
.PHONY: audit
audit: $(TOOLS) ## licences, sources and known weaknesses of what the project needs (SECURITY.md)
	cargo deny check
	$(BIN)/uvx pip-audit --require-hashes --disable-pip -r requirements-dev.txt

.PHONY: sbom
sbom: $(READY) ## what a release consists of: dist/*.cdx.json, bills of materials in CycloneDX's form
	$(BIN)/python tools/sbom.py dist

# The next target that needs the engine compiles the release again: nothing is measured with this one.
.PHONY: edit
edit: $(TOOLS) ## compile the engine quickly after an edit (the same bits; CONTRIBUTING.md)
	@$(DEVELOP) --profile edit
	@test -x $(BIN)/drm || $(INSTALL_BASELINES)
	@rm -f $(ENGINE)

.PHONY: lint
lint: $(READY) ## formatting, lints, types, generated files and the direction of dependencies
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --release -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict python/drm_env
	$(BIN)/mypy --strict baselines/drm_baselines
	$(BIN)/mypy --strict tools
	cargo test --quiet --release --workspace --test layers
	$(BIN)/lint-imports
	@fresh=$$(mktemp -d); trap 'rm -rf "$$fresh"' EXIT; \
	tools/generate.sh "$$fresh"; \
	for file in _engine.pyi _config.py _options.py; do \
	  diff -u "python/drm_env/$$file" "$$fresh/$$file" \
	    || { echo "python/drm_env/$$file is out of date: run 'make generate'" >&2; exit 1; }; \
	done
	$(BIN)/python -m mypy.stubtest drm_env._engine
	@if found=$$(cargo tree -p drm_env --edges all --all-features -i pyo3 2>&1); then \
	  echo "the engine must not depend on pyo3:" "$$found" >&2; exit 1; fi; \
	grep -q "did not match any packages" <<< "$$found" || { echo "$$found" >&2; exit 1; }

.PHONY: bench
bench: $(ENGINE) ## time the engine (Criterion)
	cargo bench

.PHONY: generate
generate: $(READY) ## rewrite the type stub and the configuration dataclasses from the Rust sources
	tools/generate.sh python/drm_env

.PHONY: lab
lab: $(ENGINE) ## the page in which the arm is flown: site/lab/index.html (docs/lab.md)
	@! command -v rustup > /dev/null || rustup target list --installed | grep -qx wasm32-unknown-unknown \
	  || rustup target add wasm32-unknown-unknown
	$(BIN)/python tools/lab.py site/lab/index.html

.PHONY: docs
docs: $(READY) ## the documentation: site/docs/index.html (the notebooks run; the engine's pages are in rust/)
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps
	rm -rf site/docs
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --jobs auto --doctree-dir site/.doctrees docs site/docs
	cp -R "$${CARGO_TARGET_DIR:-target}/doc" site/docs/rust
	$(BIN)/python tools/check_site.py site/docs

.PHONY: dist
dist: $(LIGHT) ## wheels and source distributions in dist/, each tried in an empty environment
	@test "$$(uname)" != Linux || $(BIN)/uv pip install --quiet --python $(BIN)/python ziglang==0.17.1
	@$(BIN)/uv pip install --quiet --python $(BIN)/python cyclonedx-bom==$$(awk -F '[= ]+' '/^cyclonedx-bom==/ { print $$2 }' requirements-dev.txt)
	$(BIN)/python tools/dist.py

.PHONY: clean
clean: ## remove everything that was built, the virtual environment included
	rm -rf target .venv dist site .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find python baselines tests tools -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -f python/drm_env/_engine*.so python/drm_env/_engine*.pyd

COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-emit-index-url --no-emit-find-links

.PHONY: requirements
requirements: $(TOOLS) # resolve requirements-*.in anew into requirements-*.txt
	$(COMPILE) --upgrade requirements-dev.in -o requirements-dev.txt
	$(COMPILE) --upgrade --no-annotate -c requirements-dev.txt requirements-demo.in -o requirements-demo.txt

# The installer comes by pip, in the version and with the hashes that are pinned for it; it brings the rest.
$(UV): requirements-demo.txt
	@test -x $(BIN)/python || { echo "making .venv"; $(PYTHON) -m venv .venv; }
	@awk '/^uv==/ { found = 1 } found { print } found && !/\\$$/ { exit }' requirements-demo.txt > .venv/uv.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r .venv/uv.txt
	@touch $@

$(LIGHT): $(UV)
	@echo "installing the Python packages that a look needs into .venv (seconds; 360 MB)"
	@$(BIN)/uv pip install --python $(BIN)/python --require-hashes -r requirements-demo.txt
	@touch $@

$(TOOLS): $(LIGHT) requirements-dev.txt
	@echo "installing all Python packages into .venv (about a minute, and several GB with PyTorch)"
	@$(BIN)/uv pip install --python $(BIN)/python --require-hashes -r requirements-dev.txt
	@touch $@

# Python files are imported from the source tree: only Rust and packaging files call for a rebuild.
$(ENGINE): $(LIGHT) $(RUST_SOURCES) pyproject.toml baselines/pyproject.toml
	@echo "compiling the engine (about three minutes on two cores the first time)"
	@$(DEVELOP) --release
	@$(INSTALL_BASELINES)
	@touch $@
