#include "colmap_lazyloc/intrinsics/uncalibrated_camera.h"

#include <cmath>

#include <Eigen/LU>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/intrinsics/intrinsics_estimate.h"

namespace lazyloc {
namespace {

// Standard deviations of what nobody has calibrated: the shift of the principal point and the radial displacement of
// the image's corners, over half the diagonal, and the log of the pixels' aspect ratio. All are times
// kSharedCameraFactor for a camera of the database that the photo shares, because it is probably the very one.
constexpr double kUncalibratedShift = 0.02;
constexpr double kUncalibratedDistortion = 0.005;
constexpr double kUncalibratedAspect = 0.003;
constexpr double kSharedCameraFactor = 0.25;

}  // namespace

IntrinsicsScore::Matrix UncalibratedCovariance(const IntrinsicsScore& score,
                                               const IntrinsicsScore::Matrix& score_covariance, const Camera& camera,
                                               IntrinsicsOrigin origin) {
  IntrinsicsScore::Matrix covariance = IntrinsicsScore::Matrix::Zero();
  if (IsCalibrated(origin)) return covariance;
  using Matrix = Eigen::Matrix<double, kNumOthers, kNumOthers>;
  const double radius = HalfDiagonalPx(camera);
  const double shift = kUncalibratedShift * radius;
  const double radial = kUncalibratedDistortion * radius / std::pow(radius / kRadialUnitPx, 3);
  const Eigen::Matrix<double, kNumOthers, 1> stddevs =
      (origin == IntrinsicsOrigin::SHARED ? kSharedCameraFactor : 1) *
      Eigen::Matrix<double, kNumOthers, 1>(shift, shift, kUncalibratedAspect, radial);
  const Matrix expected = stddevs.cwiseAbs2().asDiagonal();
  const Matrix inverse = score.information.bottomRightCorner<kNumOthers, kNumOthers>().inverse();
  const Matrix variance = inverse * score_covariance.bottomRightCorner<kNumOthers, kNumOthers>() * inverse;
  const Matrix gain = expected * (expected + variance).inverse();
  // Takes the expected square of the corrections, not their variance, because the pose stays that of the given camera.
  const Eigen::Matrix<double, kNumOthers, 1> mean = gain * inverse * score.score.tail<kNumOthers>();
  covariance.bottomRightCorner<kNumOthers, kNumOthers>() = gain * variance + mean * mean.transpose();
  return covariance;
}

}  // namespace lazyloc
