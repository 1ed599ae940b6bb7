#pragma once

#include <cstdint>
#include <vector>

namespace lazyloc {

// Intrinsics of a camera. Model ids and parameters are those of COLMAP's sensor/models.h; the centre of the upper-left
// pixel is (0.5, 0.5).
struct Camera {
  uint32_t camera_id = 0;
  int model_id = -1;
  uint64_t width = 0;  // pixels
  uint64_t height = 0;
  std::vector<double> params;
  bool has_prior_focal_length = false;
};

// True if both cameras map rays to the same pixels; ignores ids and prior flags.
inline bool SameIntrinsics(const Camera& a, const Camera& b) {
  return a.model_id == b.model_id && a.width == b.width && a.height == b.height && a.params == b.params;
}

}  // namespace lazyloc
