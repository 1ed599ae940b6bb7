#!/usr/bin/env bash
# Runs all steps on a rendered courtyard: builds the program, makes the scene, extracts and matches features, localizes
# the queries without a map, compares their poses with the true ones, and writes a report page. Fails unless every query
# is localized accurately. You may run it again; it skips steps that are done.
#
#   DEMO_DIR   folder for all files; default: demo below the build folder
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh

DEMO_DIR=${DEMO_DIR:-$BUILD_DIR/demo}
LOG=$DEMO_DIR/demo.log

say() { echo "demo: $*" >&2; }

colmap() {
  "$COLMAP" "$@" >> "$LOG" 2>&1 || { tail -20 "$LOG" >&2; say "colmap $1 failed; see $LOG"; return 1; }
}

# Extracts the features of images with one known camera. Arguments: list of image names, camera model, parameters
# separated by commas.
extract_features() {
  colmap feature_extractor --database_path "$DEMO_DIR/database.db" --image_path "$DEMO_DIR/images" \
    --image_list_path "$1" --ImageReader.single_camera 1 --ImageReader.camera_model "$2" \
    --ImageReader.camera_params "$3" --SiftExtraction.max_num_features 2000 --SiftExtraction.first_octave 0 \
    "$(COLMAP=$COLMAP scripts/gpu_option.sh feature_extractor)" 0
}

make_database() {
  local stamp=$DEMO_DIR/database.done model params
  [ ! "$stamp" -nt "$DEMO_DIR/scene.json" ] || [ ! "$stamp" -nt scripts/demo.sh ] || return 0
  rm -f "$stamp" "$DEMO_DIR"/database.db*

  say "extracting features"
  awk '!/^#/ && NF == 10 { print $10 }' "$DEMO_DIR/database_model/images.txt" > "$DEMO_DIR/database_names.txt"
  awk '{ print $1 }' "$DEMO_DIR/queries_with_intrinsics.txt" > "$DEMO_DIR/query_names.txt"
  read -r model params < <(awk '!/^#/ { p = $5; for (i = 6; i <= NF; ++i) p = p "," $i; print $2, p; exit }' \
    "$DEMO_DIR/database_model/cameras.txt")
  extract_features "$DEMO_DIR/database_names.txt" "$model" "$params"
  read -r model params < <(awk '{ p = $5; for (i = 6; i <= NF; ++i) p = p "," $i; print $2, p; exit }' \
    "$DEMO_DIR/queries_with_intrinsics.txt")
  extract_features "$DEMO_DIR/query_names.txt" "$model" "$params"

  say "matching each query with each database image"
  awk 'NR == FNR { names[FNR] = $1; n = FNR; next } { for (i = 1; i <= n; ++i) print $1, names[i] }' \
    "$DEMO_DIR/database_names.txt" "$DEMO_DIR/query_names.txt" > "$DEMO_DIR/pairs.txt"
  colmap matches_importer --database_path "$DEMO_DIR/database.db" --match_list_path "$DEMO_DIR/pairs.txt" \
    --match_type pairs "$(COLMAP=$COLMAP scripts/gpu_option.sh matches_importer)" 0
  touch "$stamp"
}

BUILD_TARGETS=program scripts/setup.sh
mkdir -p "$DEMO_DIR"
: > "$LOG"
"$PYTHON" -m colmap_lazyloc.demo --output_path "$DEMO_DIR"
make_database
say "localizing the queries"
colmap lazy_localizer --database_path "$DEMO_DIR/database.db" --input_path "$DEMO_DIR/database_model" \
  --query_list_path "$DEMO_DIR/queries_with_intrinsics.txt" --output_path "$DEMO_DIR/localized"
say "writing the report"
report=$("$PYTHON" -m colmap_lazyloc.report "$DEMO_DIR/localized" --image_path "$DEMO_DIR/images" \
  --database_path "$DEMO_DIR/database.db" --ground_truth "$DEMO_DIR/ground_truth/poses.txt" \
  --output "$DEMO_DIR/report.html")
"$PYTHON" -m colmap_lazyloc.evaluate "$DEMO_DIR/localized/poses.txt" --ground_truth "$DEMO_DIR/ground_truth/poses.txt" \
  --thresholds 0.01,0.1 0.05,0.2 0.25,2 --per_query --json "$DEMO_DIR/accuracy.json"
"$PYTHON" - "$DEMO_DIR/scene.json" "$DEMO_DIR/accuracy.json" << 'CHECK'
import json, sys
scene, accuracy = (json.load(open(path)) for path in sys.argv[1:])
diagonal = scene["diagonal_m"]
print("The scene measures {:g} m x {:g} m x {:g} m, {:.1f} m from corner to corner.".format(*scene["size_m"], diagonal))
if not (accuracy["num_localized"] == accuracy["num_queries"]
        and accuracy["median_position_error"] < 0.005 * diagonal and accuracy["median_rotation_error_deg"] < 0.2):
    sys.exit("demo: failed: expected every query localized, medians below 0.5 % of the scene's size and 0.2 deg")
CHECK
echo "report: $report"
