"""Finds what has changed: first what has moved, then what has vanished, then what is new."""

from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.changes.missing import find_missing
from colmap_lazyloc.changes.moved import Links, MovedThing, find_moved, is_around
from colmap_lazyloc.changes.tracks import Photos, Points, photos_of
from colmap_lazyloc.results import Change


def find_changes(photos: Photos, old: Points, new: Points, links: Links) -> list[Change]:
    """Returns the changes: first what has moved, then what has vanished, then what is new."""
    moved = find_moved(old, new, links)
    changes = [_moved(photos, old, new, links, thing) for thing in moved]
    for kind, shown, other, linked in (("vanished", old, new, links.old), ("new", new, old, links.new)):
        is_known = np.zeros(len(shown.places), bool)
        is_known[linked[links.is_static]] = True
        for thing in moved:
            is_known |= is_around(shown.places, shown.places[linked[thing.links]])
        for missing in find_missing(photos, shown, other, kind == "vanished", is_known):
            places = shown.places[missing.points]
            showing = photos_of(photos, shown, missing.points)
            sets = (showing, missing.photos) if kind == "vanished" else (missing.photos, showing)
            changes.append(
                {
                    "kind": kind,
                    "centre": places.mean(axis=0).tolist(),
                    "bounds": _bounds(places),
                    "num_points": len(places),
                    "database_photos": _boxes(photos, sets[0], places),
                    "new_photos": _boxes(photos, sets[1], places),
                }
            )
    return changes


def _moved(photos: Photos, old: Points, new: Points, links: Links, thing: MovedThing) -> Change:
    before, now = links.old[thing.links], links.new[thing.links]
    return {
        "kind": "moved",
        "centre": thing.before.tolist(),
        "centre_now": thing.now.tolist(),
        "bounds": _bounds(old.places[before]),
        "displacement": thing.displacement.tolist(),
        "displacement_stddevs": thing.stddevs.tolist(),
        "rotation_deg": thing.angle_deg,
        "num_points": len(thing.links),
        "num_matches": int(links.num_matches[thing.links].sum()),
        "database_photos": _boxes(photos, photos_of(photos, old, before), old.places[before]),
        "new_photos": _boxes(photos, photos_of(photos, new, now), new.places[now]),
    }


def _bounds(places: Floats) -> list[list[float]]:
    return [places.min(axis=0).tolist(), places.max(axis=0).tolist()]


def _boxes(photos: Photos, chosen: Sequence[int], places: Floats) -> list[Change]:
    """Returns in which part of photos points are: left, top, right and bottom in pixels."""
    boxes = []
    for index in chosen:
        camera, pixels = photos.cameras[index], photos.project(index, places)[0]
        is_inside = np.all((pixels >= 0) & (pixels <= [camera.width, camera.height]), axis=1)
        if is_inside.any():
            inside = pixels[is_inside]
            box = np.concatenate([inside.min(axis=0), inside.max(axis=0)]).round(1)
            boxes.append({"name": photos.names[index], "box": box.tolist()})
    return boxes
