"""Reads files that list pairs of images."""

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import Path, read_entries


def read_pairs(path: Path) -> list[tuple[str, str]]:
    """Reads two image names per line, as in files of hloc and COLMAP.

    Anything after the names, for example a score, is ignored; so are pairs of an image with itself.
    """
    pairs = []
    for line_number, line in read_entries(path):
        names = line.split()[:2]
        if len(names) < 2:
            raise InputError(f"{path}:{line_number}: expected two image names, found '{line}'")
        if names[0] != names[1]:
            pairs.append((names[0], names[1]))
    if not pairs:
        raise InputError(f"{path}: holds no pair of images")
    return pairs
