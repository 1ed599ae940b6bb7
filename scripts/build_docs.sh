#!/usr/bin/env bash
# Builds the documentation's site from docs/, CONTRIBUTING.md and CHANGELOG.md: one folder per version, which a browser
# opens from the disk. A broken link is an error.
#
#   scripts/build_docs.sh [FOLDER]     FOLDER: default site below the build folder; the version's folder is made in it
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
scripts/setup.sh docs
site=$(realpath -m "${1:-$BUILD_DIR/site}")/$PROJECT_VERSION
# The variable keeps the theme from announcing its successor. Warnings count as errors only if they are not silenced.
log=$(NO_MKDOCS_2_WARNING=1 "$PYTHON" -m mkdocs build --strict --clean --site-dir "$site" 2>&1) ||
  { echo "$log" >&2; exit 1; }
echo "$site/index.html"
