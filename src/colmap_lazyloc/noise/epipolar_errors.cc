#include "colmap_lazyloc/noise/epipolar_errors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/refinement/robust_loss.h"

namespace lazyloc {
namespace {

constexpr size_t kMinNumMatches = 30;
// Minimum baseline over the distance of the points (2 degrees), because the direction of a shorter one changes by more
// than a linearisation allows for.
constexpr double kMinBaselineRatio = 0.035;
// Standard deviation in pixels of deviations before the matches are known.
constexpr double kMaxDeviationPx = 15;
// Maximum keypoint noise: larger errors after the fit are those of false matches.
constexpr double kMaxNoisePx = 4;
// Standard deviation in pixels of the errors that keypoints of an area of the image have in common, for example because
// of distortion, and the number of areas: many matches do not tell a deviation more exactly than these allow.
constexpr double kCommonNoisePx = 0.2;
constexpr double kNumAreas = 16;
constexpr int kNumIterations = 6;

// An epipolar error in pixels, and its derivative by a deviation in pixels.
struct LinearError {
  double error_px = 0;
  Eigen::Matrix<double, 6, 1> slope;
};

// Returns the errors of two images' matches, and sets their scale. Returns none if too few matches have a distance, or
// the baseline is too short.
std::vector<LinearError> MakeErrors(const Eigen::Vector3d& baseline, const std::vector<RayMatch>& matches,
                                    FrameScale* scale) {
  std::vector<LinearError> errors;
  std::vector<double> distances, focal_lengths_px;
  Eigen::Matrix<double, 1, 6> jacobian;
  for (const RayMatch& match : matches) {
    const double error_px = SampsonError(match, baseline, &jacobian);
    errors.push_back({error_px, jacobian.transpose()});
    focal_lengths_px.push_back(1 / match.stddev2_rad);
    const auto nearest = FindNearestPoints(match.ray1, match.ray2, baseline);
    if (nearest && nearest->AreAhead()) distances.push_back(nearest->distance1);
  }
  if (distances.size() < kMinNumMatches / 2) return {};
  *scale = {Median(std::move(focal_lengths_px)), HarmonicMean(distances)};
  if (!(baseline.norm() >= kMinBaselineRatio * scale->distance)) return {};
  for (LinearError& error : errors) {
    error.slope.head<3>() /= scale->focal_length_px;
    error.slope.tail<3>() *= scale->distance / scale->focal_length_px;
  }
  return errors;
}

// Sets the noise and the likelihood by the errors that remain after a deviation.
void Reweight(const std::vector<LinearError>& errors, const Eigen::Matrix<double, 6, 1>& deviation, EpipolarFit* fit) {
  std::vector<double> remaining, sizes;
  for (const LinearError& error : errors) {
    remaining.push_back(error.error_px + error.slope.dot(deviation));
    sizes.push_back(std::abs(remaining.back()));
  }
  fit->noise_px = std::max(StddevOfSizes(std::move(sizes)), kCommonNoisePx);
  fit->information.setZero();
  fit->rhs.setZero();
  const RobustLoss loss(kLossScaleSigma);
  for (size_t i = 0; i < errors.size(); ++i) {
    const double sigma = remaining[i] / fit->noise_px;
    const Eigen::Matrix<double, 6, 1> weighted = loss.Weight(sigma * sigma) * errors[i].slope;
    fit->information += weighted * errors[i].slope.transpose();
    fit->rhs -= weighted * errors[i].error_px;
  }
  const double variance =
      fit->noise_px * fit->noise_px + static_cast<double>(errors.size()) / kNumAreas * kCommonNoisePx * kCommonNoisePx;
  fit->information /= variance;
  fit->rhs /= variance;
}

}  // namespace

std::optional<EpipolarFit> FitEpipolarErrors(const Eigen::Vector3d& baseline_1to2,
                                             const std::vector<RayMatch>& matches) {
  if (matches.size() < kMinNumMatches) return std::nullopt;
  EpipolarFit fit;
  const std::vector<LinearError> errors = MakeErrors(baseline_1to2, matches, &fit.scale);
  if (errors.empty()) return std::nullopt;
  Eigen::Matrix<double, 6, 1> deviation = Eigen::Matrix<double, 6, 1>::Zero();
  for (int i = 0; i < kNumIterations; ++i) {
    Reweight(errors, deviation, &fit);
    Eigen::Matrix<double, 6, 6> equations = fit.information;
    equations.diagonal().array() += 1 / (kMaxDeviationPx * kMaxDeviationPx);
    deviation = equations.ldlt().solve(fit.rhs);
  }
  if (fit.noise_px > kMaxNoisePx || !deviation.allFinite()) return std::nullopt;
  return fit;
}

}  // namespace lazyloc
