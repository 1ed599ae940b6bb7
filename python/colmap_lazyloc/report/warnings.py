"""Finds what a reader of a report should look at first."""

from typing import TypedDict

import numpy as np

from colmap_lazyloc.agreement.check import NEEDED, judge_database
from colmap_lazyloc.agreement.own_cameras import own_cameras
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.extras import is_installed
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.report.facts import METRE, format_length
from colmap_lazyloc.report.gaps import BAD_RECORD, Gaps
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.result_fields import ResultFields


class ReportWarning(TypedDict):
    """What to look at, why, and the first of the images that it is about."""

    title: str
    explanation: str
    items: "list[Item]"
    numItems: int


class Item(TypedDict):
    """A query, or a database image (query -1), that a warning is about."""

    name: str
    query: int
    text: str


MAX_NUM_ITEMS = 20
MIN_NUM_USES = 2  # queries that judge a database image
STRONG_SHARE = 0.3  # of the inliers of a query's best pair: pairs with fewer have large errors without being wrong
VERY_STRONG_SHARE = 0.7  # such a pair is left out only if it contradicts the others
MIN_DIRECTION_ERROR_DEG = 5.0  # of an image that contradicts the others
ERROR_RATIO = 5.0  # of such an image to the typical one
UNUSED_DEG = 180.0  # stands for the error of a pair that was left out
THRESHOLD_SHARE = 0.3  # of 1 - threshold: a confidence this near to the threshold is worth a look
MAX_RIG_ERROR_PX = 3.0
MAX_ERROR_SIGMA = 5.0
SAME_PLACE_RATIO = 1e-6  # of the scene's size
MIN_FAILURE_SHARE = 0.1  # of the queries that fail in the same way


def find_warnings(run: Run, size: float, database: DatabaseReader | None, gaps: Gaps) -> list[ReportWarning]:
    """Returns the warnings that have items; `size`: that of the scene."""
    finders = (
        _wrong,
        _contradicting_images,
        _own_cameras,
        _contradicted_intrinsics,
        _rig_errors,
        _near_threshold,
        _failures,
    )
    found = [
        _changes(run),
        _inaccurate_alignment(run),
        _without_poses(run),
        _contradicted_poses(run, database),
        *(find(run) for find in finders),
        _same_place(run, size),
        *_gaps(run, gaps),
    ]
    return [
        {"title": title, "explanation": explanation, "items": items[:MAX_NUM_ITEMS], "numItems": len(items)}
        for title, explanation, items in found
        if items
    ]


def _item(name: str, query: int, text: str) -> Item:
    return {"name": name, "query": query, "text": text}


def _changes(run: Run) -> tuple[str, str, list[Item]]:
    """Lists what `lazyloc changes` has found, each with the query that shows most of it."""
    queries = {name: i for i, name in enumerate(run.names)}
    items = []
    for change in run.changes:
        seen = [queries[photo["name"]] for photo in change["new_photos"] if photo["name"] in queries]
        place = ", ".join(f"{value:.2f}" for value in change["centre"])
        text = f"at {place}, {change['num_points']} points"
        if "displacement" in change:
            length, std = (np.linalg.norm(change[name]) for name in ("displacement", "displacement_stddevs"))
            text += f", by {format_length(float(length), run.unit)} ± {format_length(float(std), run.unit)}"
        items.append(_item(change["kind"], seen[0] if seen else -1, text))
    explanation = "Photos of both epochs contradict each other there. The lines in the scene show where."
    return "Things that have moved, vanished or are new", explanation, items


def _inaccurate_alignment(run: Run) -> tuple[str, str, list[Item]]:
    """Passes on what the alignment of the mapper's model has warned of."""
    explanation = "The standard deviations of the queries do not include this error of the coordinates."
    items = [_item("all images:", -1, line) for line in run.alignment[1:]]
    return "Orientation or lengths are inaccurate", explanation, items


def _without_poses(run: Run) -> tuple[str, str, list[Item]]:
    """Names the photos of which COLMAP's mapper found no pose."""
    explanation = (
        "COLMAP's mapper found no pose of these photos, so they are not used. They may overlap too little with the "
        "other photos: photos from places between them help."
    )
    return "Database images without poses", explanation, [_item(name, -1, "") for name in run.without_poses]


def _contradicted_poses(run: Run, database: DatabaseReader | None) -> tuple[str, str, list[Item]]:
    """Finds what `lazyloc check` finds: database poses that are not what they are said to be, or single wrong ones."""
    title = "Database images whose poses contradict the photos"
    explanation = "Their matches with other database images do not fit their poses."
    if database is None or not all(map(is_installed, NEEDED)):
        return title, explanation, []
    try:
        found = judge_database(database, _posed_images(run), run.unit == METRE)
    except BAD_RECORD:
        found = None
    if found is None:
        return title, explanation, []
    if found.is_wrong:
        return title, explanation, [_item("all images:", -1, found.line)]
    return title, explanation, [_item(name, -1, "contradicts the others") for name in found.contradicted]


def _posed_images(run: Run) -> list[PosedImage]:
    cameras = run.database.cameras
    return [PosedImage(image.name, cameras[image.camera_id], image.pose) for image in run.database_images]


def _own_cameras(run: Run) -> tuple[str, str, list[Item]]:
    line = own_cameras(_posed_images(run))
    items = [_item("all images:", -1, line)] if line else []
    return (
        "Each database image has a camera of its own",
        "Errors of the database poses are also in the poses of the queries.",
        items,
    )


def _wrong(run: Run) -> tuple[str, str, list[Item]]:
    """Finds localized queries whose true pose shows that they are wrong."""
    position_errors, _ = run.errors
    if run.leave_one_out is not None:
        is_wrong = {pose["name"] for pose in run.leave_one_out["poses"] if pose["is_accepted"] and pose["is_wrong"]}
    else:
        wrong = np.flatnonzero(position_errors > MAX_ERROR_SIGMA * run.position_stddevs)
        is_wrong = {run.names[i] for i in wrong if run.queries[i]["status"] == "LOCALIZED"}
    items = [
        _item(
            name,
            i,
            f"off by {format_length(position_errors[i], run.unit)}, "
            f"confidence {run.queries[i].get('confidence') or 0:.2f}",
        )
        for i, name in enumerate(run.names)
        if name in is_wrong
    ]
    items.sort(key=lambda item: -position_errors[item["query"]])
    explanation = (
        "Their positions are further from the known ones than their standard deviations allow. Either the pose is "
        "wrong, for example because the scene repeats itself, or the known pose is."
    )
    return "Localized, but away from the known pose", explanation, items


def _contradicting_images(run: Run) -> tuple[str, str, list[Item]]:
    """Finds database images whose relative poses fit the queries much worse than those of the other images."""
    uses: list[list[float]] = [[] for _ in run.database_images]
    for result in run.queries:
        for name, error_deg in _strong_pairs(result):
            if name in run.database_index:
                uses[run.database_index[name]].append(error_deg)
    # Take the lower median, because one of two queries may be wrong itself.
    medians = {
        i: sorted(errors_deg)[(len(errors_deg) - 1) // 2]
        for i, errors_deg in enumerate(uses)
        if len(errors_deg) >= MIN_NUM_USES
    }
    limit = max(ERROR_RATIO * np.median(list(medians.values()) or [0]), MIN_DIRECTION_ERROR_DEG)
    items = []
    for i, median in medians.items():
        if median > limit:
            count = f"{len(uses[i])} queries"
            text = f"median angle {median:.0f}° ({count})" if median < UNUSED_DEG else f"not used by most of {count}"
            items.append(_item(run.database_images[i].name, -1, text))
    explanation = (
        "The matches of these database images with queries do not fit the localized positions of the queries. The "
        "angle is between two directions to a query: from the matches, and to the localized position. The poses or "
        "intrinsics of these images in the input model may be wrong. Leave-one-out localization shows which are wrong."
    )
    return "Database images that contradict the others", explanation, items


def _strong_pairs(result: ResultFields) -> list[tuple[str, float]]:
    """Returns (database image, error of its direction to the query in degrees) for pairs of a localized query that have
    so many inliers that their errors are not mere noise. A wrong rotation of a database image shows in it as well."""
    if result["status"] != "LOCALIZED":
        return []
    max_num_inliers = max((pair["num_inliers"] for pair in result["pairs"]), default=0)
    pairs = []
    for pair in result["pairs"]:
        share, error_deg = pair["num_inliers"] / max(1, max_num_inliers), pair["direction_error_deg"]
        if error_deg is not None and share >= STRONG_SHARE:
            pairs.append((pair["name"], error_deg))
        elif pair["rotation_error_deg"] is None and share >= VERY_STRONG_SHARE:
            pairs.append((pair["name"], UNUSED_DEG))
    # If all errors are unknown, the query was localized without relative poses.
    return pairs if any(error_deg < UNUSED_DEG for _, error_deg in pairs) else []


def _contradicted_intrinsics(run: Run) -> tuple[str, str, list[Item]]:
    items = []
    for i, result in enumerate(run.queries):
        contradiction = (result.get("intrinsics") or {}).get("contradiction")
        if contradiction or result["status"] == "INCONSISTENT_INTRINSICS":
            items.append(_item(result["name"], i, contradiction or result["reason"]))
    explanation = (
        "The images suggest another focal length, distortion or principal point than the one that was used. Was the "
        "photo scaled or cropped? --LazyLocalizer.intrinsics refine estimates the focal length."
    )
    return "Intrinsics that the images contradict", explanation, items


def _rig_errors(run: Run) -> tuple[str, str, list[Item]]:
    items = [
        _item(result["name"], i, f"{result['rig_error_px']:.1f} px")
        for i, result in enumerate(run.queries)
        if (result.get("rig_error_px") or 0) > MAX_RIG_ERROR_PX
    ]
    items.sort(key=lambda item: -(run.queries[item["query"]]["rig_error_px"] or 0))
    explanation = (
        "These images do not fit their places in the rig or on the trajectory: points that the database images "
        "triangulate are off by several pixels. The calibration or the trajectory may be wrong."
    )
    return "Large errors within a rig", explanation, items


def _near_threshold(run: Run) -> tuple[str, str, list[Item]]:
    minimum = float(run.options.values.get("LazyLocalizer.min_confidence", 0))
    items = []
    for i, result in enumerate(run.queries):
        confidence = result.get("confidence")
        if confidence is not None and abs(confidence - minimum) <= THRESHOLD_SHARE * (1 - minimum):
            text = "accepted" if result["status"] == "LOCALIZED" else "refused"
            items.append(_item(result["name"], i, f"{text} with a confidence of {confidence:.3f}"))
    explanation = f"A few more or fewer points would have changed the status: the minimum confidence is {minimum:g}."
    return "Queries near the threshold", explanation, items


_WHAT_TO_CHECK = {
    "DAMAGED_DATA": "Records of the database are damaged, as the reasons say: make these records again.",
    "UNREADABLE_IMAGE": "Do the files exist below --image_path, and can COLMAP read their format?",
    "UNKNOWN_CAMERA": "Give the intrinsics in the query list or in --ImageReader.camera_params.",
    "NO_FEATURES": "Was feature extraction run on the queries?",
    "NO_PAIRS": "Are the queries matched with images of the model? Do the model's image names equal the database's?",
    "TOO_FEW_INLIERS": "Are the intrinsics right? Do the queries overlap with the database images?",
    "INCONSISTENT_ROTATIONS": "Are the intrinsics and the database poses right? Does the scene repeat itself?",
    "INCONSISTENT_RIG": "Is the rig's calibration or the trajectory right?",
    "SCALE_UNOBSERVABLE": "They need database images from more places, or a rig.",
    "DEGENERATE_BASELINE": "They need database images from more places, or a rig.",
    "TOO_FEW_TRACKS": "They need more matches, or database images that see the same things.",
    "INCONSISTENT_INTRINSICS": "Were the photos scaled or cropped? Are their intrinsics right?",
    "DIVERGED": "Are the intrinsics and the database poses right?",
    "LOW_CONFIDENCE": "The reason names what is missing; more database images or matches help.",
}


def _failures(run: Run) -> tuple[str, str, list[Item]]:
    """Finds statuses that so many queries share that they have one cause."""
    groups: dict[str, list[int]] = {}
    for i, result in enumerate(run.queries):
        if result["status"] != "LOCALIZED":
            groups.setdefault(result["status"], []).append(i)
    frequent = {
        status: queries
        for status, queries in groups.items()
        if len(queries) >= max(2, MIN_FAILURE_SHARE * len(run.queries))
    }
    items = [
        _item(f"{len(queries)} queries: {status}", queries[0], _WHAT_TO_CHECK.get(status, ""))
        for status, queries in sorted(frequent.items(), key=lambda item: -len(item[1]))
    ]
    return "Many queries fail in the same way", "They may have one cause.", items


def _same_place(run: Run, size: float) -> tuple[str, str, list[Item]]:
    """Finds database images whose centres are those of others."""
    centres = np.array([image.pose.cam_in_world for image in run.database_images]).reshape(-1, 3)
    cells: dict[tuple[float, ...], list[int]] = {}
    for i, cell in enumerate(map(tuple, np.round((centres - centres[:1]) / (SAME_PLACE_RATIO * size)))):
        cells.setdefault(cell, []).append(i)
    items = []
    for indices in cells.values():
        first = run.database_images[indices[0]]
        for i in indices[1:]:
            image = run.database_images[i]
            _, rotation_deg = image.pose.errors(first.pose)
            text = f"at the place of {first.name}, turned by {rotation_deg:.3g}°"
            items.append(_item(image.name, -1, text))
    explanation = (
        "Images from one place give no distance. If they were not taken there (as the faces of a panorama are), their "
        "poses are wrong or the images are copies."
    )
    return "Database images at the same place", explanation, items


def _gaps(run: Run, gaps: Gaps) -> list[tuple[str, str, list[Item]]]:
    """Finds images of which the page lacks something."""
    queries = {name: i for i, name in enumerate(run.names)}
    return [
        (title, explanation, [_item(name, queries.get(name, -1), text) for name, text in found.items()])
        for found, title, explanation in (
            (gaps.photos, "Photos that are missing or unreadable", "The page shows these images without their photos."),
            (
                gaps.records,
                "Images whose stored matches cannot be drawn",
                "The page shows them as far as the run's own files have them. Is --database_path the database of the "
                "run, as it was?",
            ),
        )
    ]
