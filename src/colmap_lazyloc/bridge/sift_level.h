#pragma once

#include <cmath>
#include <cstddef>

namespace lazyloc {

// Values that can be read after the last one of an image, so that whole vectors can be.
constexpr int kLevelPadding = 8;

// An image at one scale, row by row.
struct SiftLevel {
  const float* values = nullptr;  // owned by others
  int width = 0, height = 0;

  const float* Row(int y) const { return values + static_cast<size_t>(y) * width; }
};

// A keypoint in the pixels of its octave, with (0, 0) at the centre of the first one.
struct SiftKeypoint {
  float x = 0, y = 0;
  float scale = 0;

  // The pixel that it is in.
  int PixelX() const { return static_cast<int>(std::floor(x + 0.5)); }
  int PixelY() const { return static_cast<int>(std::floor(y + 0.5)); }
};

}  // namespace lazyloc
