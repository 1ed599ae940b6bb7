#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Corrections of the intrinsics but the first of IntrinsicsParameter, the focal length's.
inline constexpr int kNumOtherCorrections = NUM_INTRINSICS_PARAMETERS - 1;
using OtherCorrections = Eigen::Matrix<double, kNumOtherCorrections, 1>;
using OtherCovariance = Eigen::Matrix<double, kNumOtherCorrections, kNumOtherCorrections>;

// Factor on the variances of a score, because errors common to all database images, as of rolling shutters, pretend
// other intrinsics without making the images disagree.
inline constexpr double kCommonErrorFactor = 4;

// Corrections of a camera that nobody has calibrated.
struct CorrectionDistribution {
  OtherCorrections mean = OtherCorrections::Zero();
  OtherCovariance covariance = OtherCovariance::Zero();
};

// Returns what is known of a camera whose intrinsics nobody has measured. Most cameras have their principal point in
// the centre of the image and no distortion to speak of, as in a rendered, an undistorted or a reconstructed image, or
// are off by a usual amount in either; the images weigh these cases. Zero for measured intrinsics. score: of an
// adjustment, and its covariance; made: the corrections that the adjustment had.
CorrectionDistribution UncalibratedCorrections(const IntrinsicsScore& score,
                                               const IntrinsicsScore::Matrix& score_covariance,
                                               const OtherCorrections& made, const Camera& camera,
                                               IntrinsicsOrigin origin);

}  // namespace lazyloc
