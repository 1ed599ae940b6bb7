#pragma once

#include <cstdint>
#include <vector>

namespace lazyloc {

// COLMAP's camera: model id and parameters as in COLMAP's sensor/models.h, pixel convention with the
// upper-left pixel's centre at (0.5, 0.5).
struct Camera {
  uint32_t camera_id = 0;
  int model_id = -1;
  uint64_t width = 0;
  uint64_t height = 0;
  std::vector<double> params;
  bool has_prior_focal_length = false;
};

// Whether both map rays to the same pixels (ids and prior flags aside).
inline bool SameIntrinsics(const Camera& a, const Camera& b) {
  return a.model_id == b.model_id && a.width == b.width && a.height == b.height && a.params == b.params;
}

}  // namespace lazyloc
