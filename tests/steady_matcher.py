"""Matches features as `colmap matches_importer`, exactly instead of by a random search, and lets COLMAP verify them.

steady_matcher.py COLMAP matches_importer OPTIONS
"""

import os
import pathlib
import sqlite3
import sys

import numpy as np

MAX_RATIO, MAX_DISTANCE_RAD = 0.8, 0.7  # COLMAP's


def read_descriptors(path):
    query = "SELECT name, data, rows, cols FROM images JOIN descriptors USING (image_id)"
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
        rows = database.execute(query).fetchall()
    return {
        name: np.frombuffer(data, np.uint8).reshape(rows, cols).astype(np.float32) for name, data, rows, cols in rows
    }


def best(angles):
    """Returns the column of the smallest angle of each row, -1 where it does not stand out."""
    columns = np.argmin(angles, axis=1)
    first, second = np.partition(angles, 1, axis=1)[:, :2].T
    return np.where((first <= MAX_DISTANCE_RAD) & (first < MAX_RATIO * second), columns, -1)


def match(descriptors1, descriptors2):
    cosines = descriptors1 @ descriptors2.T / 512**2
    angles = np.arccos(np.minimum(cosines, 1))
    forth, back = best(angles), best(angles.T)
    return [(row, column) for row, column in enumerate(forth) if column >= 0 and back[column] == row]


def main(words):
    options = dict(zip(words[2::2], words[3::2]))
    descriptors = read_descriptors(options["--database_path"])
    listed = pathlib.Path(options["--match_list_path"])
    path = listed.with_name("raw.txt")
    with path.open("w") as file:
        for line in listed.read_text().splitlines():
            name1, name2 = line.split()
            file.write(f"{name1} {name2}\n")
            file.writelines(f"{row} {column}\n" for row, column in match(descriptors[name1], descriptors[name2]))
            file.write("\n")
    words[words.index("pairs")] = "raw"
    words[words.index(str(listed))] = str(path)
    os.execv(words[0], words)


if __name__ == "__main__":
    main(sys.argv[1:])
