#!/bin/sh
# Builds the viewer of the report page from python/viewer into python/colmap_lazyloc/report.
# With --check: builds into a temporary folder instead and compares the files with those in the repository.
# Needs Node.js and npm; exit code 3 if npm is missing, 1 if a file differs.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
report=$root/python/colmap_lazyloc/report
# Use the npm that `scripts/setup.sh npm` installs where the machine has none.
PATH=$PATH:${XDG_CACHE_HOME:-$HOME/.cache}/colmap_lazyloc/venv/bin

if ! command -v npm > /dev/null; then
  echo "npm is missing; install Node.js to build the viewer of the report page" >&2
  exit 3
fi
cd "$root/python/viewer"
npm ci --ignore-scripts --no-audit --no-fund --loglevel=error
npm run --silent check
if [ "${1:-}" != --check ]; then
  exec node build.mjs "$report"
fi

built=$(mktemp -d)
trap 'rm -rf "$built"' EXIT
node build.mjs "$built"
for file in viewer.js viewer.css viewer_licenses.txt; do
  if ! cmp -s "$built/$file" "$report/$file"; then
    echo "python/colmap_lazyloc/report/$file differs from what python/viewer builds; run scripts/build_viewer.sh" >&2
    exit 1
  fi
done
echo "The viewer of the report page equals what python/viewer builds."
