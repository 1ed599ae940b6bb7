#!/usr/bin/env bash
# Builds the Debian packages colmap-lazyloc (the program) and python3-colmap-lazyloc (the tool lazyloc and the Python
# package) from a source package, and puts all of them into a folder (default: dist). The source package contains what
# Debian lacks, COLMAP's source without its parts under restrictive licences for example. The packages are for the Debian
# that builds them, and can be installed beside Debian's package colmap.
#
#   scripts/build_deb.sh [FOLDER]
#
#   DEBFULLNAME, DEBEMAIL   who answers for the packages: their maintainer; default: the author of the last commit
#   RELEASE_URL             where the packages' source will lie; default: http://localhost:8000
#   DEB_BUILD_OPTIONS       default: nocheck (no unit tests) noautodbgsym (no packages of debugging symbols)
#
# Ends with an error if a component is under the GPL or AGPL, or if lintian finds an error. It compiles with
# Debian's hardening flags, COLMAP too; ccache has the objects next time.
set -euo pipefail
target=$(realpath -m "${1:-dist}")
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh
scripts/setup.sh source
scripts/setup.sh npm
install_packages scripts/deb_packages.txt

# The part of the version after the tilde tells the packages for several Debians apart.
source /etc/os-release
version=$PROJECT_VERSION-1~deb$VERSION_ID
maintainer="${DEBFULLNAME:-$(git log -1 --format=%an)} <${DEBEMAIL:-$(git log -1 --format=%ae)}>"
work=$BUILD_DIR/deb
source=$work/colmap-lazyloc-$PROJECT_VERSION
vendored=$work/vendored
rm -rf "$work"
mkdir -p "$source" "$vendored/python" "$target"
git archive HEAD | tar -x -C "$source" --exclude=packaging/debian --exclude=report/viewer.js
mkdir "$vendored/colmap"
cp -r "$COLMAP_SOURCE_DIR"/{CMakeLists.txt,COPYING.txt,cmake,src} "$vendored/colmap"
rm -r "$vendored"/colmap/src/thirdparty/{LSD,SiftGPU}
cp -r "$ONNXRUNTIME_INCLUDE_DIR" "$vendored/onnxruntime"
cp -r "$VENV_DIR"/lib/python3*/site-packages/nanobind{,-*} "$vendored/python"
# The packages' build makes the viewer of the report page from its source and that of three.js.
cp -r "$source/python/viewer" "$work"
(cd "$work/viewer" && PATH=$PATH:$VENV_DIR/bin npm ci --ignore-scripts --no-audit --no-fund --loglevel=error > "$work/log")
mkdir "$vendored/three"
cp -r "$work"/viewer/node_modules/three/{LICENSE,package.json,src} "$vendored/three"
find "$vendored" -name __pycache__ -prune -exec rm -r {} +

# Packs a folder of $work into a tarball that depends on nothing but its files.
pack() {
  tar -cJf "$work/colmap-lazyloc_$PROJECT_VERSION.$1.tar.xz" -C "$work" --sort=name --owner=0 --group=0 --numeric-owner \
    --mtime="@$(git log -1 --format=%ct)" "$2"
}
pack orig "colmap-lazyloc-$PROJECT_VERSION"
pack orig-vendored vendored
mv "$vendored" "$source"
cp -r packaging/debian "$source"
sed -i "s/@MAINTAINER@/$maintainer/; s|@URL@|${RELEASE_URL:-http://localhost:8000}|" "$source"/debian/{control,watch}
cat > "$source/debian/changelog" << END
colmap-lazyloc ($version) $VERSION_CODENAME; urgency=medium

  * $(git log -1 --format=%h): CHANGELOG.md of the project lists the changes.

 -- $maintainer  $(git log -1 --format=%cD)
END
# Debugging symbols would be thrown away. ccache must not follow HOME, which debhelper sets.
export DEB_CFLAGS_APPEND=-g0 DEB_CXXFLAGS_APPEND=-g0 DEB_BUILD_OPTIONS=${DEB_BUILD_OPTIONS-nocheck noautodbgsym}
export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache
export CCACHE_DIR=${CCACHE_DIR:-$(ccache --get-config cache_dir)}
(cd "$source" && dpkg-buildpackage --no-sign) > "$work/log" 2>&1 ||
  { tail -20 "$work/log" | cut -c 1-300 >&2; exit 1; }
lintian --allow-root --fail-on error "$work"/*.changes
mv "$work"/*.{deb,dsc,changes,buildinfo,tar.*} "$target"
ls "$target"/*"_${version}_"*.deb
