"""Tests of `lazyloc changes`: things that have moved, vanished or are new, of scenes with exactly known matches."""

import itertools
import json

import numpy as np
import pytest

from colmap_lazyloc.__main__ import main
from colmap_lazyloc.changes.find import find_changes
from colmap_lazyloc.changes.moved import link
from colmap_lazyloc.changes.tracks import Photos, triangulate
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import look_at

CAMERA = Camera("PINHOLE", 800, 600, (600.0, 600.0, 400.0, 300.0))
NOISE_PX = 0.3
NUM_PHOTOS = 6  # of each epoch
SHIFT = np.array([0.4, -0.1, 0.0])


def wall(random, count=800):
    """Makes points of a wall at y = 4."""
    return np.column_stack([random.uniform(-4, 4, count), np.full(count, 4.0), random.uniform(-3, 3, count)])


def box(random, count=120):
    """Makes points of the front of a box, which stands 1.5 before the wall."""
    return np.column_stack([random.uniform(-0.5, 0.5, count), np.full(count, 2.5), random.uniform(-0.5, 0.5, count)])


class Scene:
    """Photographs points of two epochs. names: what makes two points the same one, for the features. found: share of
    the box's points that become features in a photo."""

    def __init__(self, old, new, old_names, new_names, photos_of_wall=NUM_PHOTOS, noise_px=NOISE_PX, found=1.0):
        random = np.random.default_rng(5)
        self.photos_of_wall, self.found = photos_of_wall, found
        centres, rotations, self.pixels, self.seen = [], [], [], []
        for epoch, points, names in ((0, old, old_names), (1, new, new_names)):
            for i in range(NUM_PHOTOS):
                centre = np.array([-2.5 + i + 0.3 * epoch, -4.0, 0.3 * (i % 2)])
                rotation = look_at(centre, np.array([0.0, 3.0, 0.0]), (0, 0, -1), 0.0)
                centres.append(centre)
                rotations.append(rotation)
                self._add(points, names, centre, rotation, is_near_only=epoch == 1 and i >= photos_of_wall)
        sizes = [len(pixels) for pixels in self.pixels]
        pixels = np.concatenate(self.pixels) + random.normal(0, noise_px, (sum(sizes), 2))
        self.photos = Photos(
            [f"{i:02}" for i in range(2 * NUM_PHOTOS)],
            np.repeat([False, True], NUM_PHOTOS),
            [CAMERA] * (2 * NUM_PHOTOS),
            np.array(rotations),
            np.array(centres),
            np.full(2 * NUM_PHOTOS, 600.0),
            np.concatenate([[0], np.cumsum(sizes)]),
            np.repeat(np.arange(2 * NUM_PHOTOS), sizes),
            pixels,
            (pixels - CAMERA.params[2:]) / 600,
        )

    def _add(self, points, names, centre, rotation, is_near_only):
        """Adds the points that a camera sees: those on the wall only if no box is before them."""
        in_cam = (points - centre) @ rotation.T
        pixels = 600 * in_cam[:, :2] / in_cam[:, 2:] + CAMERA.params[2:]
        front = points[:, 1] < 3
        hidden = np.zeros(len(points), bool)
        if front.any():
            low, high = pixels[front].min(axis=0), pixels[front].max(axis=0)
            hidden = ~front & np.all((pixels > low) & (pixels < high), axis=1)
        is_seen = np.all((pixels >= 0) & (pixels < [800, 600]), axis=1) & ~hidden
        if is_near_only:
            is_seen &= np.abs(points[:, 0]) > 1.5
        is_seen &= ~front | (np.random.default_rng(len(self.pixels)).uniform(size=len(points)) < self.found)
        self.pixels.append(pixels[is_seen])
        self.seen.append([name for name, seen in zip(names, is_seen) if seen])

    def matches(self, is_wanted):
        """Returns the keypoints with equal names in pairs of photos."""
        found = []
        for i, j in itertools.combinations(range(2 * NUM_PHOTOS), 2):
            if not is_wanted(i < NUM_PHOTOS, j < NUM_PHOTOS):
                continue
            index = {name: k for k, name in enumerate(self.seen[j])}
            first, second = self.photos.first[i], self.photos.first[j]
            found += [(first + k, second + index[name]) for k, name in enumerate(self.seen[i]) if name in index]
        return np.array(found)

    def changes(self):
        old = triangulate(self.photos, self.matches(lambda a, b: a and b))
        new = triangulate(self.photos, self.matches(lambda a, b: not a and not b))
        return find_changes(self.photos, old, new, link(old, new, self.matches(lambda a, b: a != b)))


def make(old_box, new_box, num_in_box=120, **more):
    random = np.random.default_rng(1)
    behind = wall(random)
    names = [f"wall{i}" for i in range(len(behind))]
    boxes = [f"box{i}" for i in range(num_in_box)]
    epochs = []
    for shift in (old_box, new_box):
        points = (
            behind if shift is None else np.concatenate([behind, box(np.random.default_rng(2), num_in_box) + shift])
        )
        epochs.append((points, names if shift is None else names + boxes))
    return Scene(epochs[0][0], epochs[1][0], epochs[0][1], epochs[1][1], **more)


def test_nothing_has_changed():
    assert make(np.zeros(3), np.zeros(3)).changes() == []


def test_moved_box_has_its_displacement_and_deviation():
    (change,) = json.loads(json.dumps(make(np.zeros(3), SHIFT).changes()))
    assert change["kind"] == "moved" and change["num_points"] > 80
    error = change["displacement"] - SHIFT
    assert np.all(np.abs(error) < 4 * np.array(change["displacement_stddevs"])) and np.linalg.norm(error) < 0.01
    assert np.all(np.array(change["displacement_stddevs"]) < 0.01) and change["rotation_deg"] < 0.5
    assert len(change["database_photos"]) == len(change["new_photos"]) == NUM_PHOTOS


def test_thing_with_a_dense_texture_moves_by_less_than_its_size():
    (change,) = make(np.zeros(3), SHIFT, num_in_box=600, noise_px=1.0).changes()
    assert change["kind"] == "moved" and change["num_points"] > 500


@pytest.mark.parametrize("kind", ["vanished", "new"])
def test_box_that_is_there_in_one_epoch(kind):
    epochs = (np.zeros(3), None) if kind == "vanished" else (None, np.zeros(3))
    (change,) = make(*epochs).changes()
    assert change["kind"] == kind and change["num_points"] > 80
    assert np.allclose(change["centre"], [0, 2.5, 0], atol=0.1)
    left, top, right, bottom = change["database_photos"][0]["box"]
    assert right - left > 70 and bottom - top > 70


def test_box_vanished_most_of_whose_points_are_in_two_photos():
    """These points are not missing, but do not speak for the box, either."""
    (change,) = make(np.zeros(3), None, found=0.3, num_in_box=240).changes()
    assert change["kind"] == "vanished" and 40 < change["num_points"] < 120


def test_nothing_is_said_where_fewer_than_two_photos_could_show_it():
    assert make(np.zeros(3), None, photos_of_wall=1).changes() == []


def test_windows_that_look_alike_have_not_moved():
    """Every third point of the wall is matched with its neighbour to the right, which looks alike."""
    random = np.random.default_rng(1)
    grid = np.array([(x, 4.0, z) for x in np.arange(-4, 4, 0.2) for z in np.arange(-3, 3, 0.2)])
    points = grid + random.normal(0, 0.01, grid.shape) * [1, 0, 1]
    names = [f"wall{i}" for i in range(len(points))]
    rows = len(np.arange(-3, 3, 0.2))
    renamed = [f"wall{i - rows}" if i % 3 == 0 and i >= rows else name for i, name in enumerate(names)]
    assert Scene(points, points, names, renamed).changes() == []


def test_pattern_that_repeats_has_not_moved():
    """Two boxes look alike. Old photos are matched with new ones only by the left box in the old and the right one in
    the new photos."""
    random = np.random.default_rng(1)
    points = np.concatenate([wall(random), *(box(np.random.default_rng(2)) + [x, 0, 0] for x in (-1, 1))])
    kinds = [[f"{kind}{i}" for i in range(count)] for kind, count in (("wall", 800), ("left", 120), ("right", 120))]
    old = kinds[0] + kinds[1] + kinds[2]
    new = kinds[0] + [f"new {name}" for name in kinds[1]] + kinds[1]
    assert Scene(points, points, old, new).changes() == []


def test_folder_without_an_epoch_is_named(tmp_path, capsys):
    assert main(["changes", str(tmp_path)]) == 1
    assert str(tmp_path) in capsys.readouterr().err
