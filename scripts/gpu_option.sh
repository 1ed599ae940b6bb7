#!/usr/bin/env bash
# Prints the name of the use_gpu option of COLMAP's feature_extractor or matchers, which differs between COLMAP 3 and 4.
#
#   scripts/gpu_option.sh COMMAND
set -euo pipefail
PYTHON=${PYTHON:-python3} "$(dirname "$0")/python.sh" -m colmap_lazyloc.program "$@"
