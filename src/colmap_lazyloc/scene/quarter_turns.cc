#include "colmap_lazyloc/scene/quarter_turns.h"

#include <cmath>

namespace lazyloc {

Keypoint Turned(const Keypoint& keypoint, int quarter_turns, float width, float height) {
  const auto [x, y, a11, a12, a21, a22] = keypoint;
  switch (quarter_turns) {
    case 1: return {y, width - x, a21, a22, -a11, -a12};
    case 2: return {width - x, height - y, -a11, -a12, -a21, -a22};
    case 3: return {height - y, x, -a21, -a22, a11, a12};
    default: return keypoint;
  }
}

int TurnsOfExif(int orientation) {
  switch (orientation) {
    case 3: return 2;
    case 6: return 3;
    case 8: return 1;
    default: return 0;
  }
}

bool IsMirrored(int orientation) {
  return orientation == 2 || orientation == 4 || orientation == 5 || orientation == 7;
}

int TurnsBeforeExtraction(const Keypoint& keypoint) {
  return (static_cast<int>(std::lround(std::atan2(keypoint.a21, keypoint.a11) / (M_PI / 2))) + 4) % 4;
}

}  // namespace lazyloc
