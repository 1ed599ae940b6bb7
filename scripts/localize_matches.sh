#!/usr/bin/env bash
# Localizes queries from your own matches. DATABASE has the keypoints of all images; COLMAP's feature_importer can write
# them. MATCHES is a text file for COLMAP's matches_importer: for each pair a line `name1 name2`, then a line
# `index1 index2` per match, then an empty line. The script does not change DATABASE: it writes the matches to a copy,
# OUTPUT.db.
#
#   scripts/localize_matches.sh DATABASE MATCHES MODEL OUTPUT [options of colmap lazy_localizer]
set -euo pipefail
[ $# -ge 4 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 1; }
source "$(dirname "$0")/find_colmap.sh"
database=$1 matches=$2 model=$3 output=${4%/}
shift 4
[ ! -e "$output.db" ] || { echo "localize_matches.sh: $output.db exists already" >&2; exit 1; }
cp "$database" "$output.db"
"$COLMAP" matches_importer --database_path "$output.db" --match_list_path "$matches" --match_type raw \
  "$("$(dirname "$0")/gpu_option.sh" matches_importer)" 0 > "$output.log" 2>&1 || { tail -5 "$output.log" >&2; exit 1; }
"$COLMAP" lazy_localizer --database_path "$output.db" --input_path "$model" --output_path "$output" "$@"
