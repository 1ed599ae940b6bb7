#include "colmap_lazyloc/group/uncalibrated_camera.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace lazyloc {
namespace {

// Standard deviations of what nobody has calibrated: the shift of the principal point and the radial displacement of
// the image's corners, over half the diagonal, where there is none to speak of and where there is; the displacement by
// the fifth power, over that by the third; and the log of the pixels' aspect ratio. All are times kSharedCameraFactor
// for a camera of the database that the photo shares, because it is probably the very one.
constexpr double kNegligible = 0.001;
constexpr double kUncalibratedShift = 0.02;
constexpr double kUncalibratedRadial = 0.05;
constexpr double kFifthPowerRatio = 0.4;
constexpr double kUncalibratedAspect = 0.003;
constexpr double kSharedCameraFactor = 0.25;

// A case, with what follows from it.
struct Case {
  double log_density = 0;  // of the suggested corrections
  CorrectionDistribution corrections;
};

Case Update(const OtherCorrections& stddevs, const OtherCorrections& suggested, const OtherCovariance& covariance) {
  const OtherCovariance expected = stddevs.cwiseAbs2().asDiagonal();
  const Eigen::LDLT<OtherCovariance> total(expected + covariance);
  const OtherCovariance gain = total.solve(expected).transpose();
  return {-(suggested.dot(total.solve(suggested)) + total.vectorD().array().log().sum()) / 2,
          {gain * suggested, gain * covariance}};
}

}  // namespace

CorrectionDistribution UncalibratedCorrections(const IntrinsicsScore& score,
                                               const IntrinsicsScore::Matrix& score_covariance,
                                               const OtherCorrections& made, const Camera& camera,
                                               IntrinsicsOrigin origin) {
  CorrectionDistribution mixture;
  if (IsCalibrated(origin)) return mixture;
  const OtherCovariance inverse =
      score.information.bottomRightCorner<kNumOtherCorrections, kNumOtherCorrections>().inverse();
  const OtherCorrections suggested = made + inverse * score.score.tail<kNumOtherCorrections>();
  const OtherCovariance covariance =
      inverse * score_covariance.bottomRightCorner<kNumOtherCorrections, kNumOtherCorrections>() * inverse;
  const double radius = HalfDiagonalPx(camera);
  const double unit = (origin == IntrinsicsOrigin::SHARED ? kSharedCameraFactor : 1) * radius;
  std::vector<Case> cases;
  for (const double shift : {kNegligible, kUncalibratedShift}) {
    for (const double radial : {kNegligible, kUncalibratedRadial}) {
      OtherCorrections stddevs;
      stddevs << unit * shift, unit * shift, unit / radius * kUncalibratedAspect,
          unit * radial / std::pow(radius / kRadialUnitPx, 3),
          unit * radial * kFifthPowerRatio / std::pow(radius / kRadialUnitPx, 5);
      cases.push_back(Update(stddevs, suggested, covariance));
    }
  }
  const auto by_density = [](const Case& a, const Case& b) { return a.log_density < b.log_density; };
  const double max_log_density = std::max_element(cases.begin(), cases.end(), by_density)->log_density;
  double sum = 0;
  for (const Case& one : cases) {
    const double weight = std::exp(one.log_density - max_log_density);
    const OtherCorrections& mean = one.corrections.mean;
    sum += weight;
    mixture.mean += weight * mean;
    mixture.covariance += weight * (one.corrections.covariance + mean * mean.transpose());
  }
  mixture.mean /= sum;
  mixture.covariance = mixture.covariance / sum - mixture.mean * mixture.mean.transpose();
  return mixture;
}

}  // namespace lazyloc
