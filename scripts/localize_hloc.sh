#!/usr/bin/env bash
# Localizes queries from hloc's HDF5 files. Each line of QUERIES is `name MODEL width height params...`. Writes the
# poses to OUTPUT and the database to OUTPUT.db.
#
#   scripts/localize_hloc.sh FEATURES.h5 MATCHES.h5 PAIRS.txt MODEL QUERIES.txt OUTPUT [options of colmap lazy_localizer]
#
# PYTHON: interpreter with the packages of scripts/requirements.txt; default: the environment that scripts/setup.sh
# makes.
set -euo pipefail
[ $# -ge 6 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 1; }
source "$(dirname "$0")/find_colmap.sh"
features=$1 matches=$2 pairs=$3 model=$4 queries=$5 output=${6%/}
shift 6
"$(dirname "$0")/python.sh" -m colmap_lazyloc.hloc_to_database \
  --features_path "$features" --matches_path "$matches" --pairs_path "$pairs" --model_path "$model" \
  --query_list_path "$queries" --database_path "$output.db"
"$COLMAP" lazy_localizer --database_path "$output.db" --input_path "$model" --query_list_path "$queries" \
  --pairs_path "$pairs" --output_path "$output" "$@"
