#!/usr/bin/env bash
# Builds Ceres Solver without SuiteSparse and libtiff without JBIG-KIT, because Debian's use these, which are under the
# GPL, and a wheel contains what its libraries use. Takes the source packages of the machine's Debian. Prints the folder
# of the libraries, in which those of an earlier run are used again. Computes 14 minutes, on a busy machine 19.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh
source /etc/os-release

prefix=$CACHE_DIR/wheel-libraries
versions=$(dpkg-query -W libceres-dev libtiff6)

# Builds the source package $1 with further arguments of CMake. Keeps its copyright file and version for the wheel's list
# of components (scripts/licences.py).
build() {
  local source name=$1
  share_of_library() { share_of_build "$name" "$work/log"; }
  say "building $name"
  fetch_source_package "$VERSION_CODENAME" "$1"
  source=$(find "$work/download" -mindepth 1 -maxdepth 1 -type d)
  cmake -S "$source" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$prefix" \
    -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache "${@:2}" \
    >> "$work/log" 2>&1 && with_progress "$work/log" share_of_library ninja -C "$work/build" install ||
    { tail -30 "$work/log" >&2; say "$1 was not built; see $work/log"; return 1; }
  mkdir -p "$prefix/components/$1"
  cp "$source/debian/copyright" "$prefix/components/$1"
  dpkg-parsechangelog -l "$source/debian/changelog" -S Version > "$prefix/components/$1/version"
  rm -rf "$work"
}

if [ "$(cat "$prefix/versions" 2> /dev/null)" != "$versions" ]; then
  install_packages scripts/wheel_packages.txt
  rm -rf "$prefix"
  build ceres-solver -DBUILD_SHARED_LIBS=OFF -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DSUITESPARSE=OFF -DCXSPARSE=OFF \
    -DLAPACK=OFF -DBUILD_TESTING=OFF -DBUILD_EXAMPLES=OFF -DBUILD_BENCHMARKS=OFF
  build tiff -Djbig=OFF -Dtiff-tools=OFF -Dtiff-tests=OFF -Dtiff-contrib=OFF -Dtiff-docs=OFF
  echo "$versions" > "$prefix/versions"
fi
echo "$prefix"
