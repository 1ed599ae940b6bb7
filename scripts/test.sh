#!/usr/bin/env bash
# Checks the form of the code, builds the project with its tests, and runs them: unit tests with ctest, whole-program
# tests with pytest.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/check.sh
scripts/setup.sh
scripts/setup.sh browser
source scripts/environment.sh

# Minimum numbers of tests, because a run must not pass if tests are missing. Raise them when you add tests.
MIN_UNIT_TESTS=954
MIN_PROGRAM_TESTS=1137

# Folder of real scenes. Their tests are skipped if it does not exist.
export LAZYLOC_SHARED_DATA=${LAZYLOC_SHARED_DATA:-$PWD/../shared/data}

num_unit_tests=$(ctest --test-dir "$BUILD_DIR" -N | sed -n 's/^Total Tests: //p')
[ "$num_unit_tests" -ge "$MIN_UNIT_TESTS" ] ||
  { echo "test: only $num_unit_tests unit tests were found, of at least $MIN_UNIT_TESTS" >&2; exit 1; }
ctest --test-dir "$BUILD_DIR" --output-on-failure --progress -j "$(nproc)" > "$BUILD_DIR/ctest.log" 2>&1 ||
  { tail -60 "$BUILD_DIR/ctest.log" >&2; exit 1; }
tail -4 "$BUILD_DIR/ctest.log"

COLMAP=$COLMAP "$PYTHON" -m pytest -q -p no:cacheprovider --junitxml "$BUILD_DIR/pytest.xml" tests
num_program_tests=$(sed -n 's/.*<testsuite [^>]*tests="\([0-9]*\)".*/\1/p' "$BUILD_DIR/pytest.xml" | head -n 1)
[ "$num_program_tests" -ge "$MIN_PROGRAM_TESTS" ] ||
  { echo "test: only $num_program_tests program tests were found, of at least $MIN_PROGRAM_TESTS" >&2; exit 1; }
