#include "colmap_lazyloc/group/uncalibrated_camera.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

// Standard deviations of what nobody has calibrated, where there is none to speak of and where there is: the shift of
// the principal point and the radial displacement of the image's corners, over half the diagonal, and the log of the
// pixels' aspect ratio; and of the displacement by the fifth power, over that by the third. All are times
// kSharedCameraFactor for a camera of the database that the photo shares, because it is probably the very one.
constexpr double kNegligible = 0.001;
constexpr double kUncalibratedShift = 0.02;
constexpr double kUncalibratedRadial = 0.05;
constexpr double kFifthPowerRatio = 0.4;
constexpr double kNegligibleAspect = 0.0003;
constexpr double kUncalibratedAspect = 0.004;
constexpr double kSharedCameraFactor = 0.25;

// A case: the distribution of the corrections under it.
template <typename Distribution>
struct Case {
  double log_density = 0;  // of what the images suggest
  Distribution corrections;
};

// Returns the standard deviations of the corrections in each case.
std::vector<OtherCorrections> StddevsByCase(const Camera& camera, IntrinsicsOrigin origin) {
  const double radius = HalfDiagonalPx(camera);
  const double unit = (origin == IntrinsicsOrigin::SHARED ? kSharedCameraFactor : 1) * radius;
  std::vector<OtherCorrections> cases;
  for (const double shift : {kNegligible, kUncalibratedShift}) {
    for (const double radial : {kNegligible, kUncalibratedRadial}) {
      for (const double aspect : {kNegligibleAspect, kUncalibratedAspect}) {
        cases.emplace_back() << unit * shift, unit * shift, unit / radius * aspect,
            unit * radial / std::pow(radius / kRadialUnitPx, 3),
            unit * radial * kFifthPowerRatio / std::pow(radius / kRadialUnitPx, 5);
      }
    }
  }
  return cases;
}

// Nothing is expected of the focal length, if it is one of the corrections.
template <typename Distribution, typename Matrix, typename Vector>
Case<Distribution> Update(const OtherCorrections& stddevs, Matrix precision, const Vector& gradient) {
  precision.diagonal().template tail<kNumOtherCorrections>() += stddevs.cwiseAbs2().cwiseInverse();
  const Eigen::LDLT<Matrix> factor(precision);
  const Vector mean = factor.solve(gradient);
  return {(gradient.dot(mean) - factor.vectorD().array().log().sum()) / 2 - stddevs.array().log().sum(),
          {mean, factor.solve(Matrix::Identity())}};
}

// Returns the mean and the covariance over the cases, weighted by their densities.
template <typename Distribution>
Distribution Mix(const std::vector<Case<Distribution>>& cases) {
  const auto by_density = [](const auto& a, const auto& b) { return a.log_density < b.log_density; };
  const double max_log_density = std::max_element(cases.begin(), cases.end(), by_density)->log_density;
  double sum = 0;
  Distribution mixture;
  for (const Case<Distribution>& one : cases) {
    const double weight = std::exp(one.log_density - max_log_density);
    const auto& mean = one.corrections.mean;
    sum += weight;
    mixture.mean += weight * mean;
    mixture.covariance += weight * (one.corrections.covariance + mean * mean.transpose());
  }
  mixture.mean /= sum;
  mixture.covariance = mixture.covariance / sum - mixture.mean * mixture.mean.transpose();
  return mixture;
}

// Returns the corrections by what images show of them: `precision` * corrections = `gradient`.
template <typename Distribution, typename Matrix, typename Vector>
Distribution Corrections(const Matrix& precision, const Vector& gradient, const Camera& camera,
                         IntrinsicsOrigin origin) {
  std::vector<Case<Distribution>> cases;
  for (const OtherCorrections& stddevs : StddevsByCase(camera, origin)) {
    cases.push_back(Update<Distribution>(stddevs, precision, gradient));
  }
  return Mix(cases);
}

// Returns the displacements in pixels of an image point kRadialUnitPx from the principal point by the coefficients of
// radial distortion, each over its coefficient.
Eigen::Vector2d PxPerRadialCoefficient(const Camera& camera) {
  const double square = std::pow(kRadialUnitPx / MeanFocalLength(camera), 2);
  return kRadialUnitPx * Eigen::Vector2d(square, square * square);
}

}  // namespace

IntrinsicsInformation InformationOf(const IntrinsicsScore& score, double variance_factor) {
  return {score.information / variance_factor, score.score / variance_factor};
}

IntrinsicsDistribution JointCorrections(const IntrinsicsInformation& information, const Camera& camera,
                                        IntrinsicsOrigin origin) {
  return Corrections<IntrinsicsDistribution>(information.precision, information.gradient, camera, origin);
}

Camera WithAllCorrections(const Camera& camera) { return AsOpenCv(camera); }

IntrinsicsCorrections CorrectionsBetween(const Camera& given, const Camera& corrected) {
  IntrinsicsCorrections corrections = IntrinsicsCorrections::Zero();
  corrections[LOG_FOCAL_FACTOR] = std::log(MeanFocalLength(corrected) / MeanFocalLength(given));
  corrections[LOG_ASPECT_RATIO] = LogAspectRatio(corrected) - LogAspectRatio(given);
  corrections.segment<2>(PRINCIPAL_POINT_X) = PrincipalPoint(corrected) - PrincipalPoint(given);
  if (const std::optional<Eigen::Vector2d> radial = RadialDistortion(corrected)) {
    corrections.tail<2>() = (*radial - *RadialDistortion(given)).cwiseProduct(PxPerRadialCoefficient(corrected));
  }
  return corrections;
}

Camera Corrected(const Camera& given, const IntrinsicsCorrections& corrections) {
  Camera camera = WithFocalFactor(given, std::exp(corrections[LOG_FOCAL_FACTOR]));
  camera = WithAspectFactor(camera, std::exp(corrections[LOG_ASPECT_RATIO]));
  camera = WithShiftedPrincipalPoint(camera, corrections.segment<2>(PRINCIPAL_POINT_X));
  const std::optional<Eigen::Vector2d> radial = RadialDistortion(camera);
  if (!radial) return camera;
  return WithRadialDistortion(camera, *radial + corrections.tail<2>().cwiseQuotient(PxPerRadialCoefficient(camera)));
}

double CornerDisplacementPx(const IntrinsicsCorrections& corrections, const Camera& camera) {
  const double radius = HalfDiagonalPx(camera), ratio = radius / kRadialUnitPx;
  IntrinsicsCorrections px_from_correction;
  px_from_correction << radius, 1, 1, radius / 2, std::pow(ratio, 3), std::pow(ratio, 5);
  return corrections.cwiseProduct(px_from_correction).cwiseAbs().sum();
}

CorrectionDistribution UncalibratedCorrections(const IntrinsicsScore& score, double variance_factor,
                                               const OtherCorrections& made, const Camera& camera,
                                               IntrinsicsOrigin origin) {
  if (IsCalibrated(origin)) return {};
  const IntrinsicsInformation information = InformationOf(score, variance_factor);
  const OtherCovariance precision =
      information.precision.bottomRightCorner<kNumOtherCorrections, kNumOtherCorrections>();
  const OtherCorrections gradient = precision * made + information.gradient.tail<kNumOtherCorrections>();
  return Corrections<CorrectionDistribution>(precision, gradient, camera, origin);
}

}  // namespace lazyloc
