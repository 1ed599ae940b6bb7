#!/usr/bin/env bash
# Checks the form of the code, builds the project with its tests, and runs them: unit tests with ctest, whole-program
# tests with pytest.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/check.sh
scripts/setup.sh
scripts/setup.sh browser
scripts/setup.sh docs
source scripts/environment.sh

# Folder of real scenes. Their tests are skipped if it does not exist.
export LAZYLOC_SHARED_DATA=${LAZYLOC_SHARED_DATA:-$PWD/../shared/data}

# Fails if a file of the repository with this pattern is not a line of the input, because a run must not pass if tests are
# missing.
check_all_ran() {
  local missing
  missing=$(LC_ALL=C sort -u | LC_ALL=C comm -13 - <(git ls-files "$1" | LC_ALL=C sort))
  [ -z "$missing" ] || { echo "test: not run:" $missing >&2; return 1; }
}

grep -o 'src/colmap_lazyloc/[a-z0-9_/]*_test\.cc' "$BUILD_DIR/build.ninja" | check_all_ran 'src/*_test.cc'
ctest --test-dir "$BUILD_DIR" --no-tests=error --output-on-failure --progress -j "$(nproc)" > "$BUILD_DIR/ctest.log" 2>&1 ||
  { tail -60 "$BUILD_DIR/ctest.log" >&2; exit 1; }
tail -4 "$BUILD_DIR/ctest.log"

dist=$BUILD_DIR/dist
rm -rf "$dist"
# This wheel differs from one to pass on in two libraries, which take long to build (scripts/build_wheel.sh).
DEBIAN_LIBRARIES=1 scripts/build_wheel.sh "$dist" > "$BUILD_DIR/wheel.log"
LAZYLOC_WHEEL=$(echo "$dist"/*.whl)
export LAZYLOC_WHEEL

COLMAP=$COLMAP "$PYTHON" -m pytest -q -p no:cacheprovider --junitxml "$BUILD_DIR/pytest.xml" tests
grep -o '"tests\.test_\w*' "$BUILD_DIR/pytest.xml" | sed 's|"tests\.\(.*\)|tests/\1.py|' | check_all_ran 'tests/test_*.py'
