#pragma once

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Quarter turns of images are counter-clockwise and numbered from 0 to 3.

// Returns the turns that undo others.
inline int TurnsBack(int quarter_turns) { return (4 - quarter_turns) % 4; }

// Returns a keypoint of an image with this size in pixels where it is after the image was turned.
Keypoint Turned(const Keypoint& keypoint, int quarter_turns, float width, float height);

// Returns the turns that make the pixels of a file upright, for an orientation in EXIF. Like COLMAP 4, returns 0 for
// those that mirror the pixels (2, 4, 5, 7), and for numbers that EXIF does not have.
int TurnsOfExif(int orientation);

// True for an orientation in EXIF whose pixels are stored as a mirror image.
bool IsMirrored(int orientation);

// Returns the turns of the image that an upright keypoint was extracted from, before the keypoint was turned back:
// its shape has been turned with it.
int TurnsBeforeExtraction(const Keypoint& keypoint);

}  // namespace lazyloc
