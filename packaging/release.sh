#!/usr/bin/env bash
# Makes all files of a release in the folder dist, from a clean checkout of the tag v<version>: source distribution,
# wheel, Debian packages for the machine's Debian, container, conda recipe, documentation, lists of components (SBOM) and
# checksums. Needs podman.
#
#   packaging/release.sh
#
#   RELEASE_URL        where the files will lie; default: http://localhost:8000
#   RELEASE_KEY        GPG key that signs the checksums; default: no signature
#   PYTHONS            interpreters to make wheels for (scripts/build_wheel.sh); default: the environment's
#   CONDA_MAINTAINER   who maintains the conda package; default: the author of the last commit
#   BASE               image that the container begins with; default: that of the machine's Debian
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
source /etc/os-release
[ "$(git describe --always --dirty --tags --exact-match)" = "v$PROJECT_VERSION" ] ||
  { echo "release.sh: this is not a clean checkout of the tag v$PROJECT_VERSION" >&2; exit 1; }
[ ! -e dist ] || { echo "release.sh: the folder dist exists" >&2; exit 1; }
export RELEASE_URL=${RELEASE_URL:-http://localhost:8000}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

scripts/setup.sh source
"$PYTHON" -c 'import scikit_build_core.build as build; build.build_sdist("dist")'
for python in ${PYTHONS:-$PYTHON}; do PYTHON=$python scripts/build_wheel.sh; done
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check twine==7.0.0
"$work/venv/bin/twine" check --strict dist/*

scripts/build_deb.sh
podman build --no-cache --file packaging/Containerfile --build-arg BASE="${BASE:-debian:$VERSION_ID-slim}" \
  --tag "colmap-lazyloc:$PROJECT_VERSION" .
podman save --format oci-archive --output dist/container.tar "colmap-lazyloc:$PROJECT_VERSION"
sed "s|@VERSION@|$PROJECT_VERSION|; s|@URL@|$RELEASE_URL|; s|@MAINTAINER@|${CONDA_MAINTAINER:-$(git log -1 --format=%an)}|
  s|@SHA256@|$(sha256sum dist/colmap_lazyloc-*.tar.gz | cut -d' ' -f1)|" packaging/conda/recipe.yaml > dist/recipe.yaml
scripts/build_docs.sh "$work/site"
tar -czf dist/docs.tar.gz -C "$work/site" "$PROJECT_VERSION"

for wheel in dist/*.whl; do
  rm -rf "$work/wheel"
  "$PYTHON" -m zipfile -e "$wheel" "$work/wheel"
  cp "$work"/wheel/*.dist-info/sboms/colmap-lazyloc.cdx.json "${wheel%.whl}.cdx.json"
done
dpkg-deb -x dist/colmap-lazyloc_*.deb "$work/deb"
cp "$work"/deb/usr/share/doc/colmap-lazyloc/licences/*.json dist
(cd dist && sha256sum -- * > "$work/SHA256SUMS" && mv "$work/SHA256SUMS" .)
[ -z "${RELEASE_KEY:-}" ] || gpg --batch --local-user "$RELEASE_KEY" --armor --detach-sign dist/SHA256SUMS
ls -l dist
