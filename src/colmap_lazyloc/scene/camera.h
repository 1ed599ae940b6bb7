#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "colmap_lazyloc/scene/enum_names.h"

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

// Returns the distance of the image's corners from its centre.
inline double HalfDiagonalPx(const Camera& camera) {
  const double width = static_cast<double>(camera.width), height = static_cast<double>(camera.height);
  return std::sqrt(width * width + height * height) / 2;
}

// Source of the intrinsics of a query, which decides how far the images may correct them.
enum class IntrinsicsOrigin {
  GIVEN,    // somebody stated them: query list, option, or a camera of the database that looks calibrated
  MODEL,    // of an image that the model holds: their errors are those of the database poses, too
  JOINT,    // estimated from several queries of this camera (localizer/shared_cameras.h); their covariance is known
  SHARED,   // a camera of several posed images that has the photo's size; lens or zoom may differ
  SIMILAR,  // the camera of a single other image that has the photo's size
  EXIF,     // a focal length from EXIF, which may be off by tens of percent; principal point at the centre
  GUESS,    // COLMAP's focal length for a photo without EXIF: 1.2 times the longer side
};
template <>
inline constexpr std::array<const char*, 7> kEnumNames<IntrinsicsOrigin> = {"given",   "model", "joint", "shared",
                                                                            "similar", "exif",  "guess"};

// Returns true if the images of one query do not correct the intrinsics, because somebody, the reconstruction or
// several queries have calibrated them.
inline bool IsCalibrated(IntrinsicsOrigin origin) {
  return origin == IntrinsicsOrigin::GIVEN || origin == IntrinsicsOrigin::MODEL || origin == IntrinsicsOrigin::JOINT;
}

// Returns true if the intrinsics are those of the photo's own camera, though they may be wrong.
inline bool IsOfThisCamera(IntrinsicsOrigin origin) {
  return IsCalibrated(origin) || origin == IntrinsicsOrigin::SHARED;
}

// True if both cameras map rays to the same pixels; ignores ids and prior flags.
inline bool SameIntrinsics(const Camera& a, const Camera& b) {
  return a.model_id == b.model_id && a.width == b.width && a.height == b.height && a.params == b.params;
}

}  // namespace lazyloc
