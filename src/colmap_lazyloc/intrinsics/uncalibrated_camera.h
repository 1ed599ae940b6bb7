#pragma once

#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Returns the expected squares and products of the corrections but the focal length's of a camera whose
// intrinsics nobody has measured: by their usual sizes and the score. Zero for measured intrinsics.
IntrinsicsScore::Matrix UncalibratedCovariance(const IntrinsicsScore& score,
                                               const IntrinsicsScore::Matrix& score_covariance, const Camera& camera,
                                               IntrinsicsOrigin origin);

}  // namespace lazyloc
