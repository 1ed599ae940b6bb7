#!/usr/bin/env bash
# Makes the tables and plots of docs/benchmarks/: all methods on the same matches, error against K, noise of the
# database poses, three seeds. Then it writes the expected results of these scenes. Run it on an idle machine, because
# it measures times.
#
#   scripts/benchmark_scenes.sh [DATA]   folder of scenes, each with model/, database.db and optionally queries.txt;
#                                        default: ../shared/data
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh

DATA=${1:-../shared/data}
WORK=$BUILD_DIR/benchmark
BENCHMARK_PYTHON=$WORK/venv/bin/python
REQUIREMENTS=benchmarks/localization/requirements.txt

CMAKE_ARGS="${CMAKE_ARGS:-} -DLAZYLOC_BENCHMARKS=ON" BUILD_TARGETS="program lazyloc_ablation_benchmark" \
  scripts/setup.sh
if ! [ "$WORK/venv/done" -nt "$REQUIREMENTS" ]; then
  python3 -m venv "$WORK/venv"
  "$BENCHMARK_PYTHON" -m pip install --quiet -r scripts/requirements.txt -r "$REQUIREMENTS"
  touch "$WORK/venv/done"
fi

run() {
  local tag=$1
  shift
  rm -f "$WORK/$tag".*
  "$BENCHMARK_PYTHON" -m benchmarks run --dataset scenes --data_path "$DATA" --colmap "$COLMAP" --work_path "$WORK/work" \
    --output_path "$WORK" --tag "$tag" "$@" > /dev/null
}

run scenes --methods all --plots
run paper --scenes fountain herzjesu office kitchen skull headset corridor kitti1 --methods lazyloc lazyloc:paper \
  ablation:{l1,quaternion_mean,lud,averaging_alone,lud_alone,sampson,relative_pose_lo}
run scenes_top_k --methods structure_based lazyloc local_triangulation --num_retrieved 2 5 10 20 --plots
run scenes_noise --methods structure_based lazyloc lazyloc:exact_database lazyloc:stated_noise \
  --database_noise 0,0 1,0 5,0 10,0 0,1 0,5 0,10 1,5
run scenes_seeds --methods lazyloc local_triangulation --seeds 0 1 2

for page in scenes paper scenes_top_k scenes_noise scenes_seeds; do
  "$PYTHON" scripts/checks/tables.py --take "$WORK/$page.md"
done
cp "$WORK"/scenes*.svg docs/benchmarks/
"$BENCHMARK_PYTHON" -m benchmarks compare "$WORK/scenes.csv" --methods lazyloc \
  --write_expected benchmarks/localization/expected/scenes.json
