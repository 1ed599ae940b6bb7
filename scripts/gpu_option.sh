#!/usr/bin/env bash
# Prints the name of the use_gpu option of COLMAP's feature_extractor or matchers, which differs between COLMAP 3 and 4.
#
#   scripts/gpu_option.sh COMMAND
set -euo pipefail
[ $# -eq 1 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 1; }
help=$("${COLMAP:-colmap}" "$1" -h 2>&1) || true
grep -o -m 1 -e '--\(Sift\|Feature\)\(Extraction\|Matching\)\.use_gpu' <<< "$help"
