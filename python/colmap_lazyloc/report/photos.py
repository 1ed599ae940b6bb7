"""Reads photos: those that a page shows, scaled down, and the colours of points."""

import dataclasses
import pathlib

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.pose_formats.posed_images import decode_as_stored
from colmap_lazyloc.progress import progress
from colmap_lazyloc.report.gaps import Gaps
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.report.scene_points import ScenePoints

MAX_SIZE = 640  # of a photo in the page, in pixels
JPEG_QUALITY = 80
WORST_SHARE = 0.75  # of the queries with photos: the least certain; the others are drawn at random
NUM_IMAGES = 3  # database images next to a query's photo
MAX_NUM_COLOR_PHOTOS = 400  # photos that are read only for the colours of points
COLOR_SCALE = 4  # such photos are read at a quarter of their size, which is several times faster
UNKNOWN_COLOR = 150  # grey


@dataclasses.dataclass(frozen=True)
class Photos:
    """The photos of a page: JPEG files, and where they are used."""

    files: list[bytes]
    of_query: Array  # index of each query's photo, or -1
    of_database_image: dict[int, int]  # index of a photo by that of its database image
    sizes: dict[str, tuple[int, int]]  # width and height of the photos in the folder, by name


def choose_queries(num_queries: int, max_num_images: int) -> list[int]:
    """Returns the queries that are shown with photos: the first, which are the least certain, and some at random."""
    if num_queries <= max_num_images:
        return list(range(num_queries))
    num_worst = round(WORST_SHARE * max_num_images)
    others = np.random.default_rng(0).choice(np.arange(num_worst, num_queries), max_num_images - num_worst, False)
    return [*range(num_worst), *sorted(others.tolist())]


def useful_images(run: Run, query: int) -> list[int]:
    """Returns the database images that matter most to a query: those in use, by their number of inliers."""
    pairs = [pair for pair in run.queries[query]["pairs"] if pair["name"] in run.database_index]
    pairs.sort(key=lambda pair: (pair["rotation_error_deg"] is None, -pair["num_inliers"], pair["name"]))
    return [run.database_index[pair["name"]] for pair in pairs[:NUM_IMAGES]]


def no_photos(run: Run) -> Photos:
    """Returns what a page without photos has."""
    return Photos([], np.full(len(run.queries), -1), {}, {})


def read_photos(run: Run, image_path: pathlib.Path, chosen: list[int], gaps: Gaps) -> Photos:
    """Reads the photos of the chosen queries and of their most useful database images; those that cannot be read become
    gaps."""
    queries = [i for i in chosen if run.queries[i]["status"] != "UNREADABLE_IMAGE"]
    images = sorted({image for query in queries for image in useful_images(run, query)})
    names = list(dict.fromkeys([*(run.names[i] for i in queries), *(run.database_images[i].name for i in images)]))
    files: list[bytes] = []
    sizes: dict[str, tuple[int, int]] = {}
    for name in progress(names, "photos"):
        path = image_path / name
        pixels = _read(path, 1)
        if pixels is None:
            gaps.photos[name] = f"{path} " + ("is cut off or damaged" if path.is_file() else "is missing")
            continue
        sizes[name] = (pixels.shape[1], pixels.shape[0])
        files.append(_scaled_jpeg(pixels))
    of_query = np.full(len(run.queries), -1)
    index = {name: i for i, name in enumerate(sizes)}
    of_query[queries] = [index.get(run.names[i], -1) for i in queries]
    return Photos(files, of_query, {i: index.get(run.database_images[i].name, -1) for i in images}, sizes)


def point_colors(run: Run, image_path: pathlib.Path, points: ScenePoints) -> Array:
    """Returns the colours of the points, p x 3: those in the photo of a query that sees them. Of a large run, only some
    photos are read; the other points are grey."""
    import cv2

    colors = np.full((len(points.chosen), 3), UNKNOWN_COLOR, np.uint8)
    place = np.full(len(run.points), -1)
    place[points.chosen] = np.arange(len(points.chosen))
    localized = [result["name"] for result in run.queries if result["status"] == "LOCALIZED"]
    step = -(-len(localized) // MAX_NUM_COLOR_PHOTOS) or 1
    for name in progress(localized[::step], "colours"):
        image = run.model.images[name]
        keypoints = image.points2d[image.points2d["point3d_id"] != -1]
        pixels = _read(image_path / name, COLOR_SCALE)
        if pixels is None:
            continue
        camera = run.model.cameras[image.camera_id]
        height, width = pixels.shape[:2]
        columns = np.clip(keypoints["x"] * width / camera.width, 0, width - 1).astype(int)
        rows = np.clip(keypoints["y"] * height / camera.height, 0, height - 1).astype(int)
        index = place[run.points.find(keypoints["point3d_id"])]
        seen = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)[rows, columns]
        colors[index[index >= 0]] = seen[index >= 0]
    return colors


def _read(path: pathlib.Path, scale: int) -> Array | None:
    """Reads a photo as it is stored; None if it cannot be read."""
    import cv2

    color = {1: cv2.IMREAD_COLOR, COLOR_SCALE: cv2.IMREAD_REDUCED_COLOR_4}[scale]
    try:
        return decode_as_stored(np.fromfile(path, np.uint8), color)
    except (OSError, ValueError, cv2.error):  # ValueError: of a name that no file can have
        return None


def _scaled_jpeg(pixels: Array) -> bytes:
    import cv2

    scale = MAX_SIZE / max(pixels.shape[:2])
    if scale < 1:
        size = [max(1, round(scale * length)) for length in pixels.shape[1::-1]]
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
