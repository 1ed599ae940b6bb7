#!/usr/bin/env bash
# Installs the required packages, fetches COLMAP's source and ONNX Runtime's headers, makes the Python environment and
# builds the project.
# You may run it again: each step does nothing and prints nothing if its work is done.
#
#   COLMAP_SOURCE_DIR   COLMAP source tree to build against (3.10 or 4.x); default: Debian's source package
#   BUILD_DIR           build folder; default: build below the checkout
#   CMAKE_ARGS          further arguments of the CMake configuration
#   BUILD_TARGETS       targets to build; default: all
#
# `setup.sh environment` stops before it fetches COLMAP and builds anything. `setup.sh browser` only installs what the
# tests of the report page and of the tutorials need: a browser, its driver, npm and curl. `setup.sh deb` only installs
# the tools that make the Debian package, `setup.sh docs` those that build the documentation's site.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh

say() { echo "setup: $*" >&2; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi
}

# Installs the Debian packages that a file lists.
install_packages() {
  local packages missing=()
  packages=$(sed 's/#.*//' "$1")
  for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "installing ${#missing[@]} Debian packages"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" \
    > "$CACHE_DIR/apt.log" 2>&1 || { tail -20 "$CACHE_DIR/apt.log" >&2; return 1; }
}

# Makes a folder `work` and sets `private`, the options of apt-get that fetch from Debian 13 with a private configuration,
# because the machine's configuration must not change. Uses the machine's archive and keyring, so that apt verifies
# signatures and checksums. Argument: deb or deb-src.
prepare_debian_13() {
  local archive
  debian_archive() {
    apt-get indextargets --format '$(REPO_URI) $(CODENAME) $(ORIGIN)' 'Created-By: Packages' |
      awk '$3 == "Debian" && $2 !~ /-/ { print $1; exit }'
  }
  archive=$(debian_archive)
  if [ -z "$archive" ]; then
    as_root apt-get update -qq
    archive=$(debian_archive)
  fi
  [ -n "$archive" ] || { say "apt's sources name no Debian archive"; return 1; }
  work=$(mktemp -d "$CACHE_DIR/fetch.XXXXXX")
  mkdir -p "$work/lists/partial" "$work/sources.d" "$work/download"
  echo "$1 [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $archive trixie main" > "$work/sources.list"
  private=(-q -o "Dir::Etc::sourcelist=$work/sources.list" -o "Dir::Etc::sourceparts=$work/sources.d"
           -o "Dir::State::Lists=$work/lists" -o "Dir::Cache=$work" -o "APT::Sandbox::User=$(id -un)")
  apt-get "${private[@]}" update > "$work/log" 2>&1 || { cat "$work/log" >&2; return 1; }
}

# Fetches Debian 13's source package of COLMAP.
fetch_colmap_source() {
  [ ! -f "$COLMAP_SOURCE_DIR/CMakeLists.txt" ] || return 0
  [ "$COLMAP_SOURCE_DIR" = "$DEBIAN_COLMAP_SOURCE_DIR" ] ||
    { say "COLMAP_SOURCE_DIR=$COLMAP_SOURCE_DIR holds no CMakeLists.txt"; return 1; }
  say "fetching COLMAP's source package"
  prepare_debian_13 deb-src
  (cd "$work/download" && apt-get "${private[@]}" source --download-only --tar-only colmap >> "$work/log" 2>&1) ||
    { cat "$work/log" >&2; return 1; }
  mkdir "$work/source"
  tar -xf "$work"/download/colmap_*.orig.tar.* -C "$work/source" --strip-components=1
  mv "$work/source" "$DEBIAN_COLMAP_SOURCE_DIR"
  rm -rf "$work"
}

# Fetches the headers of ONNX Runtime, which Debian 12 lacks.
fetch_onnxruntime_headers() {
  [ ! -d "$ONNXRUNTIME_INCLUDE_DIR" ] || return 0
  say "fetching the headers of ONNX Runtime"
  prepare_debian_13 deb
  (cd "$work/download" && apt-get "${private[@]}" download libonnxruntime-dev >> "$work/log" 2>&1) ||
    { cat "$work/log" >&2; return 1; }
  dpkg-deb -x "$work"/download/libonnxruntime-dev_*.deb "$work/package"
  mv "$work/package/usr/include/onnxruntime" "$ONNXRUNTIME_INCLUDE_DIR"
  rm -rf "$work"
}

# Installs the Python packages that a file lists into the environment.
install_requirements() {
  local stamp
  stamp=$VENV_DIR/$(basename "$1")
  cmp -s "$1" "$stamp" && return 0
  say "installing Python packages"
  # Update the environment in place, because other checkouts use it too. It does not contain the package, because
  # scripts/environment.sh and scripts/python.sh set PYTHONPATH to that of their own checkout.
  "$PYTHON" -c "" 2>/dev/null || python3 -m venv --clear "$VENV_DIR"
  "$VENV_DIR/bin/pip" install -q --disable-pip-version-check -r "$1"
  cp "$1" "$stamp"
}

build() {
  local log="$BUILD_DIR/build.log"
  mkdir -p "$BUILD_DIR"
  cmake -S . -B "$BUILD_DIR" -G Ninja -DCMAKE_BUILD_TYPE="${CMAKE_BUILD_TYPE:-Release}" \
    -DCOLMAP_SOURCE_DIR="$COLMAP_SOURCE_DIR" -DLAZYLOC_PYTHON=ON -DPython_EXECUTABLE="$PYTHON" \
    -DONNXRUNTIME_INCLUDE_DIR="$ONNXRUNTIME_INCLUDE_DIR" \
    -DCMAKE_CXX_COMPILER_LAUNCHER=ccache -DCMAKE_C_COMPILER_LAUNCHER=ccache \
    ${CMAKE_ARGS:-} > "$log" 2>&1 || { tail -30 "$log" >&2; return 1; }
  if ninja -C "$BUILD_DIR" -n ${BUILD_TARGETS:-} | grep -q 'no work to do'; then return 0; fi
  say "building (COLMAP too, where no cached build is found: about ten minutes on two cores); log in $log"
  ninja -C "$BUILD_DIR" ${BUILD_TARGETS:-} >> "$log" 2>&1 ||
    { grep -E 'FAILED|error|Error' "$log" | head -40 >&2; say "the build failed; see $log"; return 1; }
}

mkdir -p "$CACHE_DIR"
if [ "${1:-}" = browser ]; then
  install_packages scripts/browser_packages.txt
  install_requirements scripts/browser_requirements.txt
  exit 0
fi
if [ "${1:-}" = deb ]; then
  install_packages scripts/deb_packages.txt
  exit 0
fi
if [ "${1:-}" = docs ]; then
  install_requirements scripts/docs_requirements.txt
  exit 0
fi
install_packages scripts/packages.txt
install_requirements scripts/requirements.txt
[ "${1:-}" != environment ] || exit 0
fetch_colmap_source
fetch_onnxruntime_headers
build
