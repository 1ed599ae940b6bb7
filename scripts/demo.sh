#!/usr/bin/env bash
# Runs all steps on a rendered courtyard: builds the program, makes the scene, extracts features of the database images,
# localizes the queries from their photos without a map, compares their poses with the true ones, and writes a report
# page. Fails unless every query is localized accurately. You may run it again; it skips steps that are done. Every run
# writes the same poses, on any number of threads.
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

# Extracts the features of the database images. One thread numbers the images in the order of their names; several would
# number them in the order in which they finish.
make_database() {
  local stamp=$DEMO_DIR/database.done model params use_gpu
  [ ! "$stamp" -nt "$DEMO_DIR/scene.json" ] || [ ! "$stamp" -nt scripts/demo.sh ] || return 0
  rm -f "$stamp" "$DEMO_DIR"/database.db*

  say "extracting features of the database images"
  awk '!/^#/ && NF == 10 { print $10 }' "$DEMO_DIR/database_model/images.txt" > "$DEMO_DIR/database_names.txt"
  read -r model params < <(awk '!/^#/ { p = $5; for (i = 6; i <= NF; ++i) p = p "," $i; print $2, p; exit }' \
    "$DEMO_DIR/database_model/cameras.txt")
  use_gpu=$(COLMAP=$COLMAP scripts/gpu_option.sh feature_extractor)
  colmap feature_extractor --database_path "$DEMO_DIR/database.db" --image_path "$DEMO_DIR/images" \
    --image_list_path "$DEMO_DIR/database_names.txt" --ImageReader.single_camera 1 \
    --ImageReader.camera_model "$model" --ImageReader.camera_params "$params" \
    --SiftExtraction.max_num_features 2000 --SiftExtraction.first_octave 0 "$use_gpu" 0 "${use_gpu/use_gpu/num_threads}" 1
  touch "$stamp"
}

BUILD_TARGETS="program lazyloc_python" scripts/setup.sh
mkdir -p "$DEMO_DIR"
: > "$LOG"
scripts/lazyloc demo --output_path "$DEMO_DIR"
make_database
say "localizing the queries"
rm -f "$DEMO_DIR/matches.db"
colmap lazy_localizer --database_path "$DEMO_DIR/database.db" --input_path "$DEMO_DIR/database_model" \
  --image_path "$DEMO_DIR/images" --query_list_path "$DEMO_DIR/queries_with_intrinsics.txt" \
  --LazyLocalizer.Advanced.matches_output_path "$DEMO_DIR/matches.db" --output_path "$DEMO_DIR/localized"
say "writing the report"
report=$(scripts/lazyloc report "$DEMO_DIR/localized" --image_path "$DEMO_DIR/images" \
  --database_path "$DEMO_DIR/matches.db" --ground_truth "$DEMO_DIR/ground_truth/poses.txt" --unit m \
  --output "$DEMO_DIR/report.html")
scripts/lazyloc evaluate "$DEMO_DIR/localized" --ground_truth "$DEMO_DIR/ground_truth/poses.txt" \
  --unit m --thresholds 0.01,0.1 0.05,0.2 0.25,2 --per_query --json "$DEMO_DIR/accuracy.json"
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
