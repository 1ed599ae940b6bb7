"""Says whether poses agree with photos, in one line, and stops what would go on with wrong ones."""

import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from colmap_lazyloc.agreement.contradictions import contradicted_images
from colmap_lazyloc.agreement.explain import Explanation, explain
from colmap_lazyloc.agreement.pairs import MatchedPair
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.extras import install_command, is_installed
from colmap_lazyloc.pose_formats.conventions import COLMAP, Convention
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages

MAX_NUM_NAMED = 10  # images that contradict the others
NEEDED = ("cv2", "scipy")


def add_accept_option(add: Callable[..., Any]) -> None:
    """Adds the option that switches the check off; `add`: the function of an argument parser."""
    add("--accept_poses", action="store_true", help="go on with poses that the photos contradict; default: stop")


def check_photos(posed: PosedImages, folder: pathlib.Path, label: str, accepts: bool) -> None:
    """Compares poses with the photos below a folder; raises InputError that begins with the label if they are wrong."""
    missing = [module for module in NEEDED if not is_installed(module)]
    if missing:
        logger.warning("the poses are not compared with the photos: %s", install_command("import", missing))
        return
    from colmap_lazyloc.agreement.photo_pairs import pairs_of_photos

    pairs = pairs_of_photos(folder, posed.images)
    explanation = explain_images(pairs, posed.images, posed.convention)
    if explanation is None:
        logger.info("the poses cannot be compared with the photos: only %d pairs of photos match", len(pairs))
        return
    line = describe(explanation, "m" if posed.origin is not None else "units")
    if not is_wrong(explanation):
        logger.info(line)
        warn_of_images(pairs, posed.images)
    elif accepts:
        logger.warning(line)
    else:
        raise InputError(f"{label}: {line}; --accept_poses goes on all the same")


def explain_images(
    pairs: Sequence[MatchedPair], images: Sequence[PosedImage], convention: Convention = COLMAP
) -> Explanation | None:
    """Compares the poses of images with pairs of these; None if there are too few pairs."""
    return explain(pairs, [image.name for image in images], poses_of(images), convention)


def is_wrong(explanation: Explanation) -> bool:
    """True if the poses are not what they are said to be."""
    return explanation.reading is not None or explanation.is_hopeless


def describe(explanation: Explanation, unit: str) -> str:
    """Returns one line; `unit`: that of the poses."""
    count, given = len(explanation.pairs), explanation.given
    turned = f"{np.nanmedian(given.rotation_deg):.1f} degrees"
    if explanation.reading is not None and explanation.mended is not None:
        mended = explanation.mended
        known = int(np.count_nonzero(np.isfinite(mended.px)))
        after = (
            f"{mended.num_agreeing} of {known} agree"
            if mended.agrees
            else f"they are off by {np.nanmedian(mended.rotation_deg):.1f} degrees, not {turned}"
        )
        return (
            f"the poses do not fit the photos: {given.num_agreeing} of {count} pairs agree; as poses "
            f"{explanation.reading.title}, {after}: {explanation.reading.remedy}"
        )
    if explanation.is_hopeless:
        return (
            f"the poses do not fit the photos: {given.num_agreeing} of {count} pairs agree, and relative "
            f"poses are off by {turned}, as those of other photos would be: do the poses belong to these photos?"
        )
    if given.agrees:
        return f"poses agree with the photos: {given.num_agreeing} of {count} pairs, median {turned}"
    return (
        f"poses agree with the photos within their errors: {given.num_agreeing} of {count} pairs within 4 px; relative "
        f"poses are off by {turned} and {explanation.position_error:.2g} {unit} in the median"
    )


def warn_of_images(pairs: Sequence[MatchedPair], images: Sequence[PosedImage]) -> None:
    """Names the images whose poses contradict those of the others in pairs of these images."""
    matches, poses = Matches.of(pairs), poses_of(images)
    px = medians_by_pair(matches, errors_px(matches, poses, poses))
    contradicted = contradicted_images([(pair.first, pair.second) for pair in pairs], px)
    if contradicted:
        names = ", ".join(images[index].name for index in contradicted[:MAX_NUM_NAMED])
        more = f" and {len(contradicted) - MAX_NUM_NAMED} more" if len(contradicted) > MAX_NUM_NAMED else ""
        logger.warning("poses that contradict the others: %s%s", names, more)


def poses_of(images: Sequence[PosedImage]) -> Poses:
    """Returns the poses of images as arrays."""
    poses = [image.cam_from_world for image in images]
    rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    return Poses(rotations, np.array([pose.cam_in_world for pose in poses]).reshape(-1, 3))
