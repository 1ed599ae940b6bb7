#!/usr/bin/env bash
# Tries a Debian package or a wheel in a clean Debian without compiler and COLMAP: installs it, goes from photos of the
# demo to the report with it, follows what it prints about the report and about missing packages, and removes it. Needs
# root, debootstrap and the demo (scripts/demo.sh).
#
#   packaging/try_package.sh RELEASE PACKAGE ROOT
#
#   RELEASE   bookworm or trixie
#   PACKAGE   a file that scripts/build_deb.sh (colmap-lazyloc_*.deb) or scripts/build_wheel.sh has made
#   ROOT      folder for the system; an existing one is used again
set -euo pipefail
[ $# -eq 3 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 1; }
release=$1 package=$(realpath "$2") root=$(realpath -m "$3")
cd "$(dirname "$0")/.."
demo=${BUILD_DIR:-build}/demo
[ -f "$demo/database.db" ] || { echo "try_package.sh: $demo holds no demo; run scripts/demo.sh" >&2; exit 1; }

if [ ! -d "$root/home" ]; then
  debootstrap --variant=minbase --include=ca-certificates,python3,python3-venv "$release" "$root" > /dev/null
fi
# Lets pip and apt in the root reach what they reach outside it.
for file in /etc/resolv.conf /etc/pip.conf ${PIP_CERT:-}; do
  [ ! -f "$file" ] || install -D "$file" "$root$file"
done
work=$root/tmp/try_package
rm -rf "$work"
mkdir "$work"
cp "$package" examples/python/localize_photo.py "$work"
[[ $package != *.deb ]] || cp "$(dirname "$package")/python3-$(basename "$package")" "$work"
cp -r "$demo"/{database.db,database_model,images,queries_with_intrinsics.txt} "$work"
mkdir -p "$root/proc"
mountpoint -q "$root/proc" || mount -t proc proc "$root/proc"
trap 'umount "$root/proc"' EXIT

inside() {
  env TMPDIR=/tmp HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive PATH="/tmp/try_package/venv/bin:$PATH" \
    chroot "$root" bash -euc "cd /tmp/try_package; $1" < /dev/null
}

# Runs the tool that is installed. Each missing package must be one line that says how to install it; $1 installs what
# the report needs, and then the command that lazy_localizer has printed must work.
try_tool() {
  inside "
    lazyloc doctor
    lazyloc run --database_images images/database --poses database_model --queries images/query --output run
    lazyloc report run/localized --output run.html
    lazy_localizer --database_path database.db --input_path database_model --image_path images \
      --query_list_path queries_with_intrinsics.txt --output_path localized > lines.jsonl 2> words.txt
    tail -n 12 words.txt
    lazyloc report localized --output page.html
    sed -n 's/^report: //p' words.txt > report.sh
    touch video.mp4
    fails() {
      if \"\$@\" > /dev/null 2> error.txt; then echo \"no package is missing: \$*\"; exit 1; fi
      cat error.txt
      [ \$(wc -l < error.txt) = 1 ] && grep -q 'install ' error.txt
    }
    fails bash report.sh
    fails lazyloc report localized --output page.html --plots plots
    fails lazyloc demo --output_path demo
    fails lazyloc retrieve --descriptors_path a.h5 --input_path database_model --output_path pairs.txt
    fails lazyloc cluster --num_shards 2 --output_path sharded
    fails lazyloc import exif images --output_path gps.txt
    fails lazyloc run --database_images images/database --queries video.mp4 --output run2
    $1 > install.log 2>&1
    bash report.sh"
}

try_deb() {
  inside "apt-get update -qq; apt-get install -y -qq --no-install-recommends colmap > apt.log 2>&1"
  inside "dpkg -V colmap; sha256sum \$(dpkg -L colmap | xargs -I{} find {} -maxdepth 0 -type f) > before; wc -l before"
  inside "time apt-get install -y -qq --no-install-recommends ./*.deb > apt2.log 2>&1
    dpkg -s colmap-lazyloc | grep -E '^(Status|Installed-Size|Version)'"
  try_tool "apt-get install -y -qq --no-install-recommends python3-opencv"
  inside "read -r name intrinsics < queries_with_intrinsics.txt
    python3 localize_photo.py database.db database_model images/\$name
    lazy_indexer --help | head -n 1
    colmap-lazyloc help | grep -m 1 COLMAP
    colmap help | grep -m 1 COLMAP
    if colmap help | grep lazy_localizer; then exit 1; fi"
  inside "apt-get remove -y -qq colmap-lazyloc > apt3.log 2>&1
    if ls /usr/bin/*lazy* 2> /dev/null; then exit 1; fi
    sha256sum --quiet -c before && dpkg -V colmap && echo 'package colmap: as before'
    apt-get purge -y -qq --autoremove colmap python3-opencv > apt4.log 2>&1"
}

try_wheel() {
  inside "if command -v gcc cc c++ colmap; then exit 1; fi
    python3 -m venv venv
    time pip install --quiet ./$(basename "$package")
    du -sh venv/lib/python3*/site-packages/colmap_lazyloc*"
  try_tool "pip install --quiet 'colmap-lazyloc[report]'"
  inside "read -r name intrinsics < queries_with_intrinsics.txt
    time python localize_photo.py database.db database_model images/\$name"
}

ls -l "$package"
case $package in
  *.deb) try_deb ;;
  *.whl) try_wheel ;;
esac
