#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Corrections of the intrinsics but the first of IntrinsicsParameter, the focal length's.
inline constexpr int kNumOtherCorrections = NUM_INTRINSICS_PARAMETERS - 1;
using OtherCorrections = Eigen::Matrix<double, kNumOtherCorrections, 1>;
using OtherCovariance = Eigen::Matrix<double, kNumOtherCorrections, kNumOtherCorrections>;

// Corrections of a camera that nobody has calibrated.
struct CorrectionDistribution {
  OtherCorrections mean = OtherCorrections::Zero();
  OtherCovariance covariance = OtherCovariance::Zero();
};

// What an image says of the corrections of its camera's intrinsics: `precision` * corrections = `gradient`.
struct IntrinsicsInformation {
  IntrinsicsCovariance precision = IntrinsicsCovariance::Zero();
  IntrinsicsCorrections gradient = IntrinsicsCorrections::Zero();
};

// Returns the information of a score of intrinsics that an adjustment did not estimate. variance_factor: of the score's
// covariance over its information.
IntrinsicsInformation InformationOf(const IntrinsicsScore& score, double variance_factor);

// Corrections of all intrinsics.
struct IntrinsicsDistribution {
  IntrinsicsCorrections mean = IntrinsicsCorrections::Zero();
  IntrinsicsCovariance covariance = IntrinsicsCovariance::Zero();
};

// Returns what images show together of a camera whose intrinsics nobody has measured, under the cases of
// UncalibratedCorrections. information: the sum over the images, of corrections of `camera`.
IntrinsicsDistribution JointCorrections(const IntrinsicsInformation& information, const Camera& camera,
                                        IntrinsicsOrigin origin);

// Returns a camera of COLMAP's default models in a model that has all corrections; other cameras as they are.
Camera WithAllCorrections(const Camera& camera);
// Returns the corrections that make one camera another one of the same model.
IntrinsicsCorrections CorrectionsBetween(const Camera& given, const Camera& corrected);
// Returns the camera with the corrections that its model has.
Camera Corrected(const Camera& given, const IntrinsicsCorrections& corrections);
// Returns by how many pixels the corrections move the image's corners at most.
double CornerDisplacementPx(const IntrinsicsCorrections& corrections, const Camera& camera);

// Returns what is known of a camera whose intrinsics nobody has measured. Most cameras have their principal point in
// the centre of the image and no distortion to speak of, as in a rendered, an undistorted or a reconstructed image, or
// are off by a usual amount in either; the images weigh these cases. Zero for measured intrinsics. score: of an
// adjustment; variance_factor: of its covariance over its information; made: the corrections that the adjustment had.
CorrectionDistribution UncalibratedCorrections(const IntrinsicsScore& score, double variance_factor,
                                               const OtherCorrections& made, const Camera& camera,
                                               IntrinsicsOrigin origin);

}  // namespace lazyloc
