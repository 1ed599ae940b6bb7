#!/usr/bin/env bash
# Localizes photos: every image file below IMAGES is a query. The database needs SIFT descriptors of the posed images.
#
#   scripts/localize_images.sh DATABASE MODEL IMAGES OUTPUT [options of colmap lazy_localizer]
#
# Intrinsics come from a camera of the database with the photo's size, from EXIF or from a guess, unless you give them:
#   --ImageReader.camera_model OPENCV --ImageReader.camera_params fx,fy,cx,cy,k1,k2,p1,p2
# COLMAP: the program to use; default: the one built in this checkout, else `colmap-lazyloc`, else `colmap`.
# Later runs reuse the retrieval index in OUTPUT.index. You may delete it.
set -euo pipefail
[ $# -ge 4 ] || { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 1; }
source "$(dirname "$0")/find_colmap.sh"
database=$1 model=$2 images=$3 output=${4%/}
shift 4
queries=$(mktemp)
trap 'rm -f "$queries"' EXIT
find -L "$images" -type f -printf '%P\n' | grep -iE '\.(jpe?g|png|tiff?|bmp|pgm|ppm)$' | LC_ALL=C sort > "$queries" ||
  { echo "localize_images.sh: $images: holds no image file" >&2; exit 1; }
"$COLMAP" lazy_localizer --database_path "$database" --input_path "$model" --image_path "$images" \
  --query_list_path "$queries" --retrieval_index_path "$output.index" --output_path "$output" "$@"
