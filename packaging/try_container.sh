#!/usr/bin/env bash
# Builds the container from the packages in dist, and tries it with the demo (scripts/demo.sh): localizes, ends a run by
# SIGTERM and resumes it, and compares the poses. Needs podman, and without a registry of images debootstrap.
#
#   packaging/try_container.sh [BASE]
#
#   BASE   image to start from; default: one that debootstrap makes, of this machine's Debian
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/environment.sh
demo=$BUILD_DIR/demo
[ -f "$demo/database.db" ] || { echo "try_container.sh: $demo holds no demo; run scripts/demo.sh" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { echo "try_container.sh: $*"; }

base=${1:-localhost/lazyloc-base}
if [ $# = 0 ] && ! podman image exists "$base"; then
  source /etc/os-release
  debootstrap --variant=minbase --include=ca-certificates "$VERSION_CODENAME" "$work/root" > /dev/null
  rm -rf "$work"/root/var/{lib/apt/lists,cache/apt}/* "$work"/root/usr/share/{doc,locale,man}/*
  tar -c -C "$work/root" . | podman import --quiet - "$base" > /dev/null
fi
time podman build --no-cache --quiet --file packaging/Containerfile --build-arg BASE="$base" --tag colmap-lazyloc . > /dev/null
say "$(podman image inspect --format '{{.Size}}' colmap-lazyloc) bytes"

cp -r "$demo"/{database.db,database_model,images,queries_with_intrinsics.txt} "$work"
chmod 755 "$work"
chown -R 1000:1000 "$work"
options=(--read-only --network none --volume "$work:/data")
localize=(lazy_localizer --database_path database.db --input_path database_model --image_path images
          --query_list_path queries_with_intrinsics.txt --LazyLocalizer.num_threads 1)
podman run --rm "${options[@]}" colmap-lazyloc bash -c 'id -u; ! touch /file 2> /dev/null; lazyloc doctor'
time podman run --rm "${options[@]}" colmap-lazyloc "${localize[@]}" --output_path whole > "$work/lines"

say "SIGTERM in the middle"
podman run --detach --name lazyloc-try "${options[@]}" colmap-lazyloc "${localize[@]}" --output_path ended > /dev/null
while [ "$(podman logs lazyloc-try 2> /dev/null | wc -l)" -lt 3 ]; do sleep 0.1; done
podman kill --signal TERM lazyloc-try > /dev/null
say "exit code $(podman wait lazyloc-try), $(podman logs lazyloc-try 2> /dev/null | wc -l) of $(wc -l < "$work/lines") queries"
podman logs lazyloc-try 2>&1 > /dev/null | tail -n 2
podman rm lazyloc-try > /dev/null
[ -d "$work/ended/unfinished" ]
podman run --rm "${options[@]}" colmap-lazyloc "${localize[@]}" --output_path ended --resume 1 > /dev/null
cmp "$work"/{whole,ended}/poses.txt && say "the poses of the resumed run are those of the whole one"
podman run --rm "${options[@]}" colmap-lazyloc lazyloc report ended --output report.html
