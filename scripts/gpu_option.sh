#!/usr/bin/env bash
# Prints the option of COLMAP's feature_extractor and matchers that switches the GPU; the program is COLMAP's, or `colmap`.
#
#   scripts/gpu_option.sh COMMAND
set -euo pipefail
PYTHON=${PYTHON:-python3} "$(dirname "$0")/python.sh" -m colmap_lazyloc.program "$@"
