#pragma once

#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Mean and covariance of corrections of the intrinsics.
struct CorrectionEstimate {
  IntrinsicsScore::Vector mean = IntrinsicsScore::Vector::Zero();
  IntrinsicsScore::Matrix covariance = IntrinsicsScore::Matrix::Zero();
};

// Estimates the corrections but the focal length's, if nobody has calibrated the camera: by a normal prior and the
// images. Zero for calibrated intrinsics.
CorrectionEstimate EstimateUncalibrated(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& score_covariance,
                                        const Camera& camera, IntrinsicsOrigin origin);

// Returns the camera with corrections but the focal length's.
Camera Corrected(const Camera& camera, const IntrinsicsScore::Vector& corrections);

}  // namespace lazyloc
