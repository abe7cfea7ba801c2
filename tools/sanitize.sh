#!/usr/bin/env bash
# Runs the unsafe code that Miri cannot interpret under the address sanitiser: vector instructions, arrays of the
# bindings, memory of a page. Three faults on purpose come first, which have to be reported: what is compiled
# without the sanitiser would pass everything.
# Usage: tools/sanitize.sh [--possible]     (run from the project root; tools are taken from .venv; --possible
#        only tells by its exit status whether the toolchain has the sanitiser)
set -euo pipefail

host=$(rustc -vV | awk '/^host:/ { print $2 }')
runtime=$(find "$(rustc --print target-libdir)" -name 'librustc*_rt.asan.a' -print -quit)
if [ -z "$runtime" ] || [ "$(uname)" != Linux ]; then
  echo "there is no address sanitiser here: it comes with rustup's toolchains for Linux" >&2
  exit 1
fi
[ "${1:-}" != --possible ] || exit 0

# Flags of sanitisers belong to nightly compilers: RUSTC_BOOTSTRAP lets the stable one take them. Optimised a little,
# with the standard library's checks of unsafe calls, and with lines for the reports.
export RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=$PWD/target/sanitize
export CARGO_PROFILE_EDIT_DEBUG=line-tables-only CARGO_PROFILE_EDIT_DEBUG_ASSERTIONS=true
export CARGO_PROFILE_EDIT_INCREMENTAL=false
how=(--profile edit --target "$host")
# of the whole workspace, so that they share one engine with the extension
tests=(--workspace)
for name in lanes consistent rollout snapshots mission flight corpora; do tests+=(--test "$name"); done

echo "compiling engine, tests and extension with the sanitiser (about ten minutes on two cores the first time)"
cargo test "${how[@]}" "${tests[@]}" --no-run
cargo build "${how[@]}" -p drm-env-py

# A package of its own with the extension, and the compiler's runtime as a library that Python loads first. The part
# that starts it in a program is not for libraries; and it takes a library named libasan.so for another compiler's.
package=$CARGO_TARGET_DIR/python
rm -rf "$package"
mkdir -p "$package"
cp -R python/drm_env "$package"
rm -f "$package"/drm_env/_engine*.so
cp "$CARGO_TARGET_DIR/$host/edit/lib_engine.so" "$package/drm_env/_engine.abi3.so"
cp "$runtime" "$CARGO_TARGET_DIR/runtime.a"
ar d "$CARGO_TARGET_DIR/runtime.a" asan_preinit.cpp.o
cc -shared -o "$CARGO_TARGET_DIR/runtime.so" -Wl,--whole-archive "$CARGO_TARGET_DIR/runtime.a" \
  -Wl,--no-whole-archive -lpthread -lrt -lm -ldl
# Python's own leaks are not looked for; its small objects come from where the sanitiser watches
sanitised_python() {
  env LD_PRELOAD="$CARGO_TARGET_DIR/runtime.so" ASAN_OPTIONS=detect_leaks=0 PYTHONMALLOC=malloc \
    PYTHONPATH="$package" .venv/bin/python "$@"
}

# reported KIND ACCESS COMMAND...   the command is ended by a report of such a fault
reported() {
  local kind=$1 access=$2 report
  shift 2
  if report=$("$@" 2>&1) || ! grep -q "AddressSanitizer: $kind" <<< "$report" \
    || ! grep -q "^$access " <<< "$report"; then
    echo "$report" >&2
    echo "a fault on purpose was not reported as $kind, $access: $*" >&2
    exit 1
  fi
  grep "^SUMMARY: AddressSanitizer" <<< "$report"
}

# Functions with vector instructions are compiled apart: whether they are watched is looked up.
if [ "${host%%-*}" = x86_64 ]; then
  checks=$(objdump -d -C --no-show-raw-insn "$package/drm_env/_engine.abi3.so" | awk '
    /^[0-9a-f]+ </ { wide = /avx2::run|avx512::run|_avx2/ }
    wide && /call.*__asan_report/ { n++ }
    END { print n + 0 }')
  echo "checks of the sanitiser in functions with vector instructions: $checks"
  [ "$checks" -gt 0 ] || { echo "they are compiled without it" >&2; exit 1; }
fi

echo "faults on purpose:"
# sizes of single numbers: what compiled code read, and not a function of the C library on its behalf
reported heap-buffer-overflow "READ of size 4" cargo test "${how[@]}" --workspace --test lanes -- --ignored
reported heap-use-after-free READ cargo test "${how[@]}" --workspace --test flight -- --ignored
reported heap-buffer-overflow "READ of size 4" sanitised_python -c '
import numpy as np
import drm_env

network = drm_env.Network([(np.ones((2, 3), np.float32), np.zeros(2, np.float32))])
network(np.lib.stride_tricks.as_strided(np.zeros(599, np.float32), (200, 3), (12, 4)))'

# without the one that repeats a flight in ever smaller steps
DRM_FUZZ_CASES=100 cargo test "${how[@]}" "${tests[@]}" -- --skip power_balance_closes
# reports go past what pytest keeps of a test's output
sanitised_python -m pytest -q --capture=sys tests/test_native_arrays.py tests/test_fuzz_bindings.py \
  tests/test_properties.py -k array
