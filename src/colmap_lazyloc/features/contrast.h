#pragma once

#include <cstdint>
#include <vector>

namespace lazyloc {

// The values of an image that become black and white; white is above black.
struct Contrast {
  int black = 0, white = 255;
};

// Returns the values that 1 % of an image's values are below and above. values: at least one.
Contrast FullContrast(std::vector<uint8_t> values);

}  // namespace lazyloc
