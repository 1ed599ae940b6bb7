"""Paints walls, paving, wood and notices procedurally: with detail at all scales and without repetition."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from colmap_lazyloc.array_types import Array

Colour = tuple[int, ...]  # blue, green, red

FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_COMPLEX,
)
LETTERS = np.array(list("ABCDEFGHJKLMNPRSTUVWXYZ0123456789&?!"))


def multi_scale_noise(
    rng: Generator, shape: tuple[int, ...], coarsest: int, finest: int = 2, stretch: tuple[int, int] = (1, 1)
) -> Array:
    """Makes noise of unit variance with detail at every power of two from `finest` to `coarsest` texels."""
    height, width = shape
    noise = np.zeros(shape, np.float32)
    size = finest
    while size <= coarsest:
        cells = rng.standard_normal((height // (size * stretch[0]) + 2, width // (size * stretch[1]) + 2), np.float32)
        noise += size**0.25 * cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC)
        size *= 2
    scaled: Array = noise / noise.std()
    return scaled


def _colour(rng: Generator, low: int = 20, high: int = 235) -> Colour:
    """Draws a random colour, blended half-way with its grey."""
    colour = rng.integers(low, high, 3)
    return tuple(int(value) for value in (colour + colour.mean()) / 2)


def _tint(rng: Generator, colour: Sequence[float], spread: float) -> Colour:
    """Varies the brightness of a colour, and slightly its hue."""
    tinted = np.array(colour) * np.exp(rng.normal(0, spread)) + rng.normal(0, 6, 3)
    return tuple(int(value) for value in np.clip(tinted, 8, 245))


def _weather(rng: Generator, picture: Array, strength: float, stretch: tuple[int, int] = (1, 1)) -> Array:
    noise = multi_scale_noise(rng, picture.shape[:2], coarsest=max(4, min(picture.shape[:2]) // 3), stretch=stretch)
    return np.clip(picture * (1 + strength * noise[..., None]), 0, 255).astype(np.uint8)


def _draw_text(rng: Generator, picture: Array, box: tuple[float, float, float, float], colour: Colour) -> None:
    """Writes one line of random letters that fills the box (x, y, width, height)."""
    x, y, width, height = box
    text = "".join(rng.choice(LETTERS, rng.integers(3, 9)))
    font, thickness = FONTS[rng.integers(len(FONTS))], max(1, int(height * rng.uniform(0.06, 0.16)))
    (text_width, text_height), _ = cv2.getTextSize(text, font, 1.0, 1)
    scale = min(width / text_width, height / text_height) * 0.9
    cv2.putText(picture, text, (int(x), int(y + height * 0.9)), font, scale, colour, thickness, cv2.LINE_AA)


def _draw_polygon(rng: Generator, picture: Array, centre: ArrayLike, radius: float, colour: Colour) -> None:
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
    radii = radius * rng.uniform(0.5, 1, angles.size)
    points = np.array(centre) + np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    cv2.fillPoly(picture, [points.astype(np.int32)], colour, cv2.LINE_AA)


def draw_notice(rng: Generator, picture: Array, box: tuple[float, float, float, float]) -> None:
    """Draws a framed poster: shapes and lines of text."""
    x, y, width, height = (int(value) for value in box)
    view = picture[y : y + height, x : x + width]
    height, width = view.shape[:2]
    if min(height, width) < 8:
        return
    view[:] = _colour(rng)
    for _ in range(rng.integers(3, 9)):
        centre = rng.uniform((0, 0), (width, height))
        _draw_polygon(rng, view, centre, rng.uniform(0.08, 0.4) * min(width, height), _colour(rng))
    line_y = rng.uniform(0.02, 0.3) * height
    while line_y < 0.9 * height:
        line_height = rng.uniform(0.06, 0.22) * height
        line = (rng.uniform(0.03, 0.3) * width, line_y, 0.65 * width, line_height)
        _draw_text(rng, view, line, _colour(rng, 0, 255))
        line_y += line_height * rng.uniform(1.1, 2.0)
    cv2.rectangle(view, (0, 0), (width - 1, height - 1), _colour(rng, 10, 90), max(2, width // 60))


def draw_window(rng: Generator, picture: Array, box: tuple[float, float, float, float]) -> None:
    """Draws a dark window with a frame, bars at uneven places, curtains or reflections, and a sill."""
    x, y, width, height = (int(value) for value in box)
    frame, bar = _colour(rng, 60, 240), max(2, int(width * rng.uniform(0.03, 0.07)))
    cv2.rectangle(picture, (x, y), (x + width, y + height), _tint(rng, (70, 55, 45), 0.3), -1)
    view = picture[y : y + height, x : x + width]
    for _ in range(rng.integers(3, 8)):
        centre = rng.uniform((0, 0), (view.shape[1], view.shape[0]))
        _draw_polygon(rng, view, centre, 0.45 * width, _tint(rng, (105, 90, 75), 0.5))
    for _ in range(rng.integers(1, 4)):
        column, row = (int(value) for value in rng.uniform((x, y), (x + width, y + height)))
        cv2.line(picture, (column, y), (column, y + height), frame, bar)
        cv2.line(picture, (x, row), (x + width, row), frame, bar)
    cv2.rectangle(picture, (x, y), (x + width, y + height), frame, 2 * bar)
    cv2.rectangle(
        picture,
        (x - 2 * bar, y + height + bar),
        (x + width + 2 * bar, y + height + 4 * bar),
        _tint(rng, (150, 150, 150), 0.2),
        -1,
    )


def _lay_stones(
    rng: Generator, shape: tuple[int, ...], stone_size: float, colour: Colour, joint: int, spread: float
) -> Array:
    """Lays courses of stones that differ in height, width, outline and tint."""
    height, width = shape
    picture: Array = np.empty((height, width, 3), np.uint8)
    picture[:] = _tint(rng, [0.55 * value for value in colour], 0.1)
    y = 0
    while y < height:
        course = int(stone_size * rng.uniform(0.5, 1.2))
        x = -int(stone_size * rng.uniform(0, 1))
        while x < width:
            length = int(stone_size * rng.uniform(0.6, 2.6))
            outline = np.array([[x, y], [x + length, y], [x + length, y + course], [x, y + course]], np.float64)
            outline += np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * joint
            outline += rng.uniform(-1.5, 1.5, (4, 2)) * joint
            cv2.fillPoly(picture, [outline.astype(np.int32)], _tint(rng, colour, spread), cv2.LINE_AA)
            x += length
        y += course
    return picture


def facade(rng: Generator, size_m: Sequence[float], texels_per_m: float, colour: Colour) -> Array:
    """Paints a house front of irregular stones with windows, notices, lettering and stains."""
    width, height = (round(length * texels_per_m) for length in size_m)
    m = texels_per_m
    picture = _lay_stones(rng, (height, width), 0.3 * m, colour, max(1, int(0.012 * m)), 0.16)
    for _ in range(int(size_m[0] * size_m[1] / 3)):  # repaired plaster
        centre = rng.uniform((0, 0), (width, height))
        _draw_polygon(rng, picture, centre, rng.uniform(0.1, 0.6) * m, _tint(rng, colour, 0.25))
    x = rng.uniform(0.3, 0.8) * m
    while x < width - 1.5 * m:
        window_width = rng.uniform(0.7, 1.4) * m
        window_bottom = 0.8 * m
        while window_bottom < height - 1.6 * m:
            window_height = rng.uniform(0.8, 1.7) * m
            top = height - window_bottom - window_height
            box = (x + rng.uniform(-0.2, 0.2) * m, max(0.1 * m, top), window_width * rng.uniform(0.7, 1), window_height)
            (draw_window if rng.random() < 0.6 else draw_notice)(rng, picture, box)
            window_bottom += window_height + rng.uniform(0.6, 1.2) * m
        x += window_width + rng.uniform(0.5, 1.3) * m
    for _ in range(int(size_m[0] * size_m[1] / 4)):  # plates and painted words
        sign = rng.uniform(0.2, 0.6, 2) * m
        x, y = rng.uniform((0, 0), np.maximum((width, height) - sign, 1))
        draw_notice(rng, picture, (x, y, *sign))
        x, y = rng.uniform((0, 0), (max(1, width - m), max(1, height - m)))
        _draw_text(rng, picture, (x, y, rng.uniform(0.6, 1.6) * m, 0.35 * m), _colour(rng))
    return _weather(rng, picture, 0.13)


def paving(rng: Generator, size_m: Sequence[float], texels_per_m: float, colour: Colour) -> Array:
    """Paints slabs with painted marks, leaves and dirt."""
    width, height = (round(length * texels_per_m) for length in size_m)
    picture = _lay_stones(rng, (height, width), 0.55 * texels_per_m, colour, max(1, int(0.015 * texels_per_m)), 0.13)
    for _ in range(int(4 * size_m[0] * size_m[1])):
        radius = rng.uniform(0.03, 0.12) * texels_per_m
        leaf = _tint(rng, (40, 90, 130) if rng.random() < 0.5 else (60, 110, 70), 0.35)
        _draw_polygon(rng, picture, rng.uniform((0, 0), (width, height)), radius, leaf)
    for _ in range(int(size_m[0] * size_m[1] / 8)):
        x, y = rng.uniform((0, 0), (width, height))
        _draw_text(rng, picture, (x, y, rng.uniform(0.8, 2) * texels_per_m, 0.5 * texels_per_m), _colour(rng, 90, 240))
    return _weather(rng, picture, 0.14)


def planks(rng: Generator, size_m: Sequence[float], texels_per_m: float, colour: Colour) -> Array:
    """Paints the side of a crate: boards with grain and nails, stencilled words and labels."""
    width, height = (max(8, round(length * texels_per_m)) for length in size_m)
    picture: Array = np.zeros((height, width, 3), np.uint8)
    y = 0
    while y < height:
        board = max(4, int(rng.uniform(0.08, 0.2) * texels_per_m))
        cv2.rectangle(picture, (0, y), (width, y + board - 3), _tint(rng, colour, 0.2), -1)
        for _ in range(int(3 * size_m[0]) + 2):
            nail = (int(rng.uniform(0, width)), int(y + rng.uniform(0.2, 0.8) * board))
            cv2.circle(picture, nail, max(1, int(0.008 * texels_per_m)), _colour(rng, 10, 60), -1, cv2.LINE_AA)
        y += board
    picture = _weather(rng, picture, 0.2, stretch=(1, 6))
    for _ in range(int(3 * size_m[0] * size_m[1]) + 1):
        label = rng.uniform(0.2, 0.55, 2) * min(width, height)
        x, y = rng.uniform((0, 0), (width, height) - label)
        draw_notice(rng, picture, (x, y, *label))
        word = (rng.uniform(0, 0.4) * width, rng.uniform(0, 0.8) * height, 0.6 * width, 0.18 * height)
        _draw_text(rng, picture, word, _colour(rng, 10, 80))
    return _weather(rng, picture, 0.08)


def stone(rng: Generator, size_m: Sequence[float], texels_per_m: float, colour: Colour) -> Array:
    """Paints rough stone of a pillar, with a few notices pasted on it."""
    width, height = (max(8, round(length * texels_per_m)) for length in size_m)
    picture = _lay_stones(rng, (height, width), 0.35 * texels_per_m, colour, max(1, int(0.01 * texels_per_m)), 0.18)
    for _ in range(int(2 * size_m[0] * size_m[1]) + 1):
        notice = rng.uniform(0.4, 0.9) * width, rng.uniform(0.4, 1.0) * min(width, height)
        x, y = rng.uniform((0, 0), np.maximum((width - notice[0], height - notice[1]), 1))
        draw_notice(rng, picture, (x, y, *notice))
    return _weather(rng, picture, 0.16)
