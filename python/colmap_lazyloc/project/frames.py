"""Takes frames of a video. Needs OpenCV."""

import itertools
import os
import pathlib
from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.posed_images import IMAGE_SUFFIXES, PHONE_SUFFIXES, UNREADABLE_SUFFIXES
from colmap_lazyloc.progress import progress

JPEG_QUALITY = 95


def is_video(path: pathlib.Path) -> bool:
    """True if the path names a file that is not a photo."""
    return path.is_file() and not path.name.lower().endswith((*IMAGE_SUFFIXES, *PHONE_SUFFIXES, *UNREADABLE_SUFFIXES))


def open_video(path: pathlib.Path) -> Any:
    """Returns a video, open; raises InputError if the file is none."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # of FFmpeg: nothing, because one line says what is wrong
    import cv2

    try:
        capture = cv2.VideoCapture(str(path))
    except UnicodeError:
        raise InputError(f"{path}: OpenCV opens no video whose name is not UTF-8: rename it") from None
    if not capture.isOpened():
        raise InputError(f"{path}: is neither a photo nor a video that OpenCV can read")
    return capture


def write_frames(video: pathlib.Path, folder: pathlib.Path, frames_per_second: float) -> int:
    """Writes frames as 000123.jpg, with their numbers in the video; returns how many."""
    import cv2

    capture = open_video(video)
    folder.mkdir(parents=True, exist_ok=True)
    rate = capture.get(cv2.CAP_PROP_FPS)
    step = max(rate / frames_per_second, 1.0) if rate > 0 else 1.0
    count = 0
    for index in progress(itertools.count(), "frames of the video", int(capture.get(cv2.CAP_PROP_FRAME_COUNT))):
        if not capture.grab():
            break
        if index >= count * step:
            is_read, pixels = capture.retrieve()
            if not is_read:
                break
            path = folder / f"{index:06}.jpg"
            if not cv2.imwrite(str(path), pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
                raise InputError(f"{path}: cannot be written")
            count += 1
    capture.release()
    if count == 0:
        raise InputError(f"{video}: has no frame that OpenCV can read")
    return count
