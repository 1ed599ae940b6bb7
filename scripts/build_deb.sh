#!/usr/bin/env bash
# Builds the Debian package colmap-lazyloc and puts it into a folder (default: dist). The package holds the program that
# scripts/setup.sh has built, with man pages and bash completion made from the program's help. It is for the Debian that
# builds it, and the tool lazyloc. It can be installed beside Debian's package colmap.
#
#   scripts/build_deb.sh [FOLDER]
#
# Ends with an error if a component is under the GPL or AGPL, or if lintian finds an error.
set -euo pipefail
target=$(realpath -m "${1:-dist}")
cd "$(dirname "$0")/.."
source scripts/environment.sh
source scripts/apt.sh
BUILD_TARGETS=${BUILD_TARGETS:-program} scripts/setup.sh
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
# The tool's package is not in Python's path, because its extension module is only in the wheel.
cat > "$stage/lazyloc" << 'END'
#!/bin/sh
PYTHONPATH=/usr/share/colmap-lazyloc${PYTHONPATH:+:$PYTHONPATH} exec python3 -m colmap_lazyloc "$@"
END
chmod +x "$stage/lazyloc"
ln -s colmap-lazyloc "$stage/completions/lazyloc"
git ls-files -z python/colmap_lazyloc ':!python/colmap_lazyloc/testing' | xargs -0 cp --parents -t "$stage"
chmod -R a-x,a+X "$stage/python"
cp packaging/bash_completion "$stage/completions/colmap-lazyloc"
"$PYTHON" scripts/help_pages.py man "$COLMAP" "$stage/man"
"$PYTHON" scripts/licences.py program "$BUILD_DIR" "$stage/licences"
"$PYTHON" scripts/licences.py check "$stage/licences/colmap-lazyloc.cdx.json"

# The version is that of the project; the part after the tilde tells the packages for several Debians apart.
version=$(sed -n 's/^project(colmap_lazyloc VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
source /etc/os-release
cat > "$stage/debian/changelog" << END
colmap-lazyloc ($version~deb$VERSION_ID) $VERSION_CODENAME; urgency=medium

  * $(git log -1 --format=%h): CHANGELOG.md of the project lists the changes.

 -- $(sed -n 's/^Maintainer: //p' packaging/debian/control)  $(git log -1 --format=%cD)
END
(cd "$stage" && dpkg-buildpackage --build=binary --no-sign) > "$work/log" 2>&1 || { tail -20 "$work/log" >&2; exit 1; }
package=$(echo "$work"/*.deb)
lintian --allow-root --fail-on error "$package"
cp "$package" "$target"
echo "$target/$(basename "$package")"
