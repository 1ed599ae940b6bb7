"""Prints where a photo was taken.

python localize_photo.py database.db model photo.jpg
"""

import sys

import colmap_lazyloc as ll

database, model, photo = sys.argv[1:]
with ll.Localizer(database, model) as localizer:
    result = localizer.localize_photo(photo)
if result.position is None:
    sys.exit(f"{result.status}: {result.reason}")
print("position", *result.position)
