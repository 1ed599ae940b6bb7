#!/usr/bin/env bash
# Installs the required packages, fetches COLMAP's source and ONNX Runtime's headers, makes the Python environment and
# builds the project.
# You may run it again: each step does nothing and prints nothing if its work is done.
#
#   COLMAP_SOURCE_DIR   COLMAP source tree to build against (3.10 or 4.x); default: Debian's source package
#   BUILD_DIR           build folder; default: build below the checkout
#   DEBIAN_ARCHIVE      address of an archive of Debian, on systems whose apt has none (Ubuntu)
#   CMAKE_ARGS          further arguments of the CMake configuration
#   BUILD_TARGETS       targets to build; default: all
#
# `setup.sh environment` stops before it fetches COLMAP and builds anything, `setup.sh source` before it builds.
# `setup.sh browser` only installs what the tests of the report page and of the tutorials need: a browser, its driver, npm
# and curl, `setup.sh npm` only npm, `setup.sh docs` what builds the documentation's site. `setup.sh colmap TARBALL SHA256`
# only unpacks an archive of COLMAP's source, which builds then take in place of Debian's source package.
set -euo pipefail
tarball=$(realpath -m "${2:-/dev/null}")
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh

# Fetches Debian 13's source package of COLMAP.
fetch_colmap_source() {
  [ ! -f "$COLMAP_SOURCE_DIR/CMakeLists.txt" ] || return 0
  [ "$COLMAP_SOURCE_DIR" = "$DEBIAN_COLMAP_SOURCE_DIR" ] ||
    { say "COLMAP_SOURCE_DIR=$COLMAP_SOURCE_DIR holds no CMakeLists.txt"; return 1; }
  say "fetching COLMAP's source package"
  fetch_source_package trixie colmap --download-only --tar-only ||
    { say "COLMAP's source can also be that of COLMAP_SOURCE_DIR, or of 'setup.sh colmap TARBALL SHA256'"; return 1; }
  unpack_colmap_source "$work"/download/colmap_*.orig.tar.*
  rm -rf "$work"
}

# Unpacks a release of COLMAP to where builds look for its source.
unpack_colmap_source() {
  local folder
  folder=$(mktemp -d "$CACHE_DIR/colmap.XXXXXX")
  tar -xf "$1" -C "$folder" --strip-components=1
  [ -f "$folder/src/colmap/exe/colmap.cc" ] || { rm -rf "$folder"; say "$1 holds no source of COLMAP"; return 1; }
  chmod 755 "$folder"
  rm -rf "$DEBIAN_COLMAP_SOURCE_DIR"
  mv -T "$folder" "$DEBIAN_COLMAP_SOURCE_DIR"
}

# Fetches the headers of ONNX Runtime, which Debian 12 lacks.
fetch_onnxruntime_headers() {
  [ ! -d "$ONNXRUNTIME_INCLUDE_DIR" ] || return 0
  say "fetching the headers of ONNX Runtime"
  prepare_debian deb trixie
  (cd "$work/download" && apt-get "${private[@]}" download libonnxruntime-dev >> "$work/log" 2>&1) ||
    { cat "$work/log" >&2; return 1; }
  dpkg-deb -x "$work"/download/libonnxruntime-dev_*.deb "$work/package"
  mv "$work/package/usr/include/onnxruntime" "$ONNXRUNTIME_INCLUDE_DIR"
  rm -rf "$work"
}

# Installs the Python packages that a file lists into the environment.
install_requirements() {
  local stamp start list=$1 log=$CACHE_DIR/pip.log
  stamp=$VENV_DIR/$(basename "$1")
  cmp -s "$1" "$stamp" && return 0
  say "installing Python packages"
  # Update the environment in place, because other checkouts use it too. It does not contain the package, because
  # scripts/environment.sh and scripts/python.sh set PYTHONPATH to that of their own checkout.
  "$PYTHON" -c "" 2>/dev/null || python3 -m venv --clear "$VENV_DIR"
  share_of_requirements() {
    local num_packages num_done
    num_packages=$(sed -n 's/^Installing collected packages: //p' "$log" | wc -w)
    if [ "$num_packages" -gt 0 ]; then
      num_done=$(find "$VENV_DIR"/lib/python*/site-packages -maxdepth 1 -name '*.dist-info' -newermt "@$start" | wc -l)
      share "unpacking Python packages" "$num_done" "$num_packages" packages
    else
      # pip learns only while it downloads what the packages of the list need. Its lines end with what needs a package.
      num_done=$(sed -nE 's/^(Collecting|Requirement already satisfied:) ([^ ]+).*/\2/p' "$log" | grep -cFf "$list" || true)
      echo "$(share "downloading Python packages" "$num_done" \
        "$(grep -c . "$list")" "of the list"); $(grep -c '^ *Downloading' "$log") files with what these need"
    fi
  }
  start=$(date +%s.%N) # after the pip that comes with a new environment
  : > "$log"
  with_progress "$log" share_of_requirements "$VENV_DIR/bin/pip" install --progress-bar off \
    --disable-pip-version-check -r "$list" || { tail -20 "$log" >&2; return 1; }
  cp "$list" "$stamp"
}

build() {
  local log="$BUILD_DIR/build.log"
  mkdir -p "$BUILD_DIR"
  cmake --preset release -B "$BUILD_DIR" ${CMAKE_BUILD_TYPE:+-DCMAKE_BUILD_TYPE="$CMAKE_BUILD_TYPE"} \
    -DCOLMAP_SOURCE_DIR="$COLMAP_SOURCE_DIR" -DPython_EXECUTABLE="$PYTHON" \
    -DONNXRUNTIME_INCLUDE_DIR="$ONNXRUNTIME_INCLUDE_DIR" \
    ${CMAKE_ARGS:-} > "$log" 2>&1 || { tail -30 "$log" >&2; return 1; }
  if ninja -C "$BUILD_DIR" -n ${BUILD_TARGETS:-} | grep -q 'no work to do'; then return 0; fi
  say "building (COLMAP too, unless ccache has it: 10 to 20 minutes on two cores); log in $log"
  share_of_project() { share_of_build "${BUILD_TARGETS:-everything}" "$log"; }
  with_progress "$log" share_of_project ninja -C "$BUILD_DIR" ${BUILD_TARGETS:-} ||
    { grep -E 'FAILED|error|Error' "$log" | head -40 >&2; say "the build failed; see $log"; return 1; }
}

if [ "${1:-}" = colmap ]; then
  [ "$(sha256sum < "$tarball")" = "${3:-}  -" ] || { say "$2 has another SHA-256 than '${3:-}'"; exit 1; }
  unpack_colmap_source "$tarball"
  exit 0
fi
if [ "${1:-}" = browser ]; then
  install_packages scripts/browser_packages.txt
  install_requirements scripts/browser_requirements.txt
  install_requirements scripts/npm_requirements.txt
  exit 0
fi
if [ "${1:-}" = npm ]; then
  install_requirements scripts/npm_requirements.txt
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
[ "${1:-}" = source ] || build
