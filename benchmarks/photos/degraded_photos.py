"""Copies of photos as if taken with less light, out of focus or in haze."""

import cv2
import numpy as np

FULL_WELL = 4000  # electrons of the brightest pixel in the given photo
READ_NOISE = 3  # electrons
HAZE_LEVEL = 215  # grey value of what is too far to be seen
REFERENCE_WIDTH = 640  # of a photo in which a strength of 1 blurs by a pixel


def darken(photo: np.ndarray, strength: float, random: np.random.Generator) -> np.ndarray:
    """Takes the photo with 1/strength of the light. The camera brightens it by half as many stops."""
    electrons = FULL_WELL * (photo / 255) ** 2.2 / strength
    seen = random.poisson(electrons) + random.normal(0, READ_NOISE, photo.shape)
    return _to_bytes(255 * (np.clip(seen, 0, None) / FULL_WELL * np.sqrt(strength)) ** (1 / 2.2))


def blur(photo: np.ndarray, strength: float, random: np.random.Generator) -> np.ndarray:
    """Takes the photo out of focus. Noise is as in the others, because a blurred photo has as much."""
    sigma = strength * photo.shape[1] / REFERENCE_WIDTH
    return _to_bytes(cv2.GaussianBlur(photo.astype(np.float64), (0, 0), sigma) + random.normal(0, 1, photo.shape))


def haze(photo: np.ndarray, strength: float, random: np.random.Generator) -> np.ndarray:
    """Leaves 1/strength of the contrast, and adds the light of the haze."""
    return _to_bytes(HAZE_LEVEL + (photo - float(HAZE_LEVEL)) / strength + random.normal(0, 1, photo.shape))


def _to_bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
