#!/usr/bin/env bash
# Builds the Debian packages colmap-lazyloc (the program) and python3-colmap-lazyloc (the tool lazyloc and the Python
# package) and puts them into a folder (default: dist). They hold what scripts/setup.sh has built, with man pages and bash
# completion made from the program's help. They are for the Debian that builds them, and can be installed beside Debian's
# package colmap.
#
#   scripts/build_deb.sh [FOLDER]
#
#   DEBFULLNAME, DEBEMAIL   who answers for the packages: their maintainer; default: the author of the last commit
#
# Ends with an error if a component is under the GPL or AGPL, or if lintian finds an error.
set -euo pipefail
target=$(realpath -m "${1:-dist}")
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh
BUILD_TARGETS=${BUILD_TARGETS:-program lazyloc_python} scripts/setup.sh
install_packages scripts/deb_packages.txt

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
stage=$work/stage
mkdir -p "$stage/completions" "$target"
cp -r packaging/debian README.md docs "$stage"
cp "$COLMAP" "$stage/colmap-lazyloc"
for command in lazy_indexer lazy_localizer lazy_merger; do
  printf '#!/bin/sh\nexec colmap-lazyloc %s "$@"\n' "$command" > "$stage/$command"
  chmod +x "$stage/$command"
  ln -s colmap-lazyloc "$stage/completions/$command"
done
printf '#!/bin/sh\nexec python3 -m colmap_lazyloc "$@"\n' > "$stage/lazyloc"
chmod +x "$stage/lazyloc"
ln -s colmap-lazyloc "$stage/completions/lazyloc"
git ls-files -z python/colmap_lazyloc ':!python/colmap_lazyloc/testing' | xargs -0 cp --parents -t "$stage"
chmod -R a-x,a+X "$stage/python"
cp "$BUILD_DIR"/python/_core.*.so "$stage/python/colmap_lazyloc"
cp packaging/bash_completion "$stage/completions/colmap-lazyloc"
"$PYTHON" scripts/help_pages.py man "$COLMAP" "$stage/man"
"$PYTHON" scripts/licences.py program "$BUILD_DIR" "$stage/licences"
"$PYTHON" scripts/licences.py check "$stage/licences/colmap-lazyloc.cdx.json"

# The version is that of the project; the part after the tilde tells the packages for several Debians apart.
version=$PROJECT_VERSION
maintainer="${DEBFULLNAME:-$(git log -1 --format=%an)} <${DEBEMAIL:-$(git log -1 --format=%ae)}>"
sed -i "s/@MAINTAINER@/$maintainer/" "$stage/debian/control"
source /etc/os-release
cat > "$stage/debian/changelog" << END
colmap-lazyloc ($version~deb$VERSION_ID) $VERSION_CODENAME; urgency=medium

  * $(git log -1 --format=%h): CHANGELOG.md of the project lists the changes.

 -- $maintainer  $(git log -1 --format=%cD)
END
(cd "$stage" && dpkg-buildpackage --build=binary --no-sign) > "$work/log" 2>&1 || { tail -20 "$work/log" >&2; exit 1; }
lintian --allow-root --fail-on error "$work"/*.deb
cp "$work"/*.deb "$target"
ls "$target"/*"_$version~deb$VERSION_ID"_*.deb
