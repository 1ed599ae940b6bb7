#!/usr/bin/env bash
# Localizes queries as a job array of SLURM, one shard per task, and merges the shards in a job that waits for them.
#
#   scripts/localize_slurm.sh NUM_SHARDS OUTPUT [options of lazy_localizer...]
#
# Start it in a folder that all nodes see. Starting it again submits only the shards that are not finished, and these go
# on where they ended. A task that fails does not hold up the others: the merger then names what is missing, in
# OUTPUT.shards/merger.log. Each shard has a log beside its folder.
#
#   COLMAP           program on the nodes; default: colmap
#   SBATCH_OPTIONS   options of sbatch for all jobs, such as "--partition short --cpus-per-task 4 --mem 8G"
set -euo pipefail
COLMAP=${COLMAP:-colmap}

fail() { echo "localize_slurm: $*" >&2; exit 1; }

[ $# -ge 2 ] || fail "usage: $0 NUM_SHARDS OUTPUT [options of lazy_localizer...]"
num_shards=$1 output=$2
shift 2
[[ $num_shards =~ ^[1-9][0-9]*$ ]] || fail "NUM_SHARDS must be a whole number of at least 1, but is '$num_shards'"
command -v sbatch > /dev/null || fail "sbatch is missing: start this script on a node of SLURM"
shards=$output.shards
mkdir -p "$shards"

# Prints the indices of the shards that are not finished, as sbatch --array takes them.
list_unfinished() {
  local index
  for ((index = 1; index <= num_shards; ++index)); do
    if [ ! -f "$shards/$index/shard/manifest.json" ] || [ -e "$shards/$index/unfinished" ]; then echo "$index"; fi
  done | paste -sd,
}

# Submits a job that runs the given text in a shell; prints the number of the job.
submit() {
  local name=$1 log=$2 text=$3
  shift 3
  # SBATCH_OPTIONS is split into words on purpose.
  # shellcheck disable=SC2086
  sbatch --parsable --job-name "$name" --output "$log" --open-mode append ${SBATCH_OPTIONS:-} "$@" --wrap "$text"
}

options=$(printf '%q ' "$@")
[[ " $options" == *" --LazyLocalizer.num_threads"* ]] ||
  options+='--LazyLocalizer.num_threads "${SLURM_CPUS_PER_TASK:-1}"'
shards_quoted=$(printf '%q' "$shards")
localize="exec $(printf '%q' "$COLMAP") lazy_localizer $options --output_path $shards_quoted/\$SLURM_ARRAY_TASK_ID \
--shard \$SLURM_ARRAY_TASK_ID/$num_shards --resume 1"
merge="exec $(printf '%q ' "$COLMAP" lazy_merger --input_path "$shards" --output_path "$output")"

unfinished=$(list_unfinished)
dependency=()
if [ -n "$unfinished" ]; then
  job=$(submit lazy_localizer "$shards/%a.log" "$localize" --array "$unfinished" --requeue)
  echo "job $job: shards $unfinished of $num_shards, logs in $shards"
  dependency=(--dependency "afterany:${job%%;*}")
fi
job=$(submit lazy_merger "$shards/merger.log" "$merge" "${dependency[@]}")
echo "job $job: merger, log in $shards/merger.log"
