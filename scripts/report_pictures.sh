#!/usr/bin/env bash
# Makes the pictures of the demo's report in docs/pictures, from the report that scripts/demo.sh wrote.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/setup.sh browser
source scripts/environment.sh
PYTHONPATH=tests:$PYTHONPATH "$PYTHON" scripts/report_pictures.py "${1:-$BUILD_DIR/demo/report.html}" docs/pictures
