#include "colmap_lazyloc/refinement/epipolar_errors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/refinement/robust_loss.h"

namespace lazyloc {
namespace {

constexpr size_t kMinNumMatches = 30;
// Minimum baseline over the distance of the points (2 degrees), because the direction of a shorter one changes by more
// than a linearisation allows for.
constexpr double kMinBaselineRatio = 0.035;
// Minimum sine of the angle between two rays (1 degree) whose point has a distance.
constexpr double kMinCrossingSine = 0.0175;
// Standard deviation in pixels of deviations before the matches are known.
constexpr double kMaxDeviationPx = 15;
// Bounds of the keypoint noise. Errors that are larger after the fit are those of false matches.
constexpr double kMinNoisePx = 0.2, kMaxNoisePx = 4;
// Standard deviation in pixels of the errors that keypoints of an area of the image have in common, for example because
// of distortion, and the number of areas: many matches do not tell a deviation more exactly than these allow.
constexpr double kCommonNoisePx = 0.2;
constexpr double kNumAreas = 16;
constexpr double kLossScale = 2;  // in standard deviations
constexpr int kNumIterations = 6;

// An epipolar error in pixels, and its derivative by a deviation in pixels.
struct EpipolarError {
  double error_px = 0;
  Eigen::Matrix<double, 6, 1> slope = Eigen::Matrix<double, 6, 1>::Zero();
};

struct Rays {
  Eigen::Vector3d ray, other_ray;  // in world axes
};

// Returns the derivative along in_cam of a ray's displacement, for a keypoint error of one pixel in any direction.
double SlopePx(const Observation& observation, const Eigen::Vector3d& in_cam) {
  const Eigen::Matrix<double, 2, 3>& px_from_cam = observation.px_from_cam;
  return ((px_from_cam * px_from_cam.transpose()).inverse() * (px_from_cam * in_cam)).norm();
}

EpipolarError MakeError(const MatchedRays& match, const Rays& rays, const Eigen::Vector3d& baseline,
                        const Rigid3d& cam_from_world, const Rigid3d& other_from_world) {
  // The error baseline . (ray x other_ray) changes by by_other . dother_ray, by_ray . dray and normal . dbaseline.
  const Eigen::Vector3d by_other = baseline.cross(rays.ray), by_ray = rays.other_ray.cross(baseline);
  const Eigen::Vector3d normal = rays.ray.cross(rays.other_ray);
  const double stddev = std::hypot(SlopePx(match.observation, cam_from_world.rotation * by_ray),
                                   SlopePx(match.other_observation, other_from_world.rotation * by_other));
  EpipolarError error;
  if (!(stddev > 0)) return error;
  error.error_px = baseline.dot(normal) / stddev;
  // A turn of the other camera by w in the world's axes moves other_ray by other_ray x w.
  // A step along the baseline changes error and standard deviation by the same factor.
  const Eigen::Vector3d across = normal - normal.dot(baseline) / baseline.squaredNorm() * baseline;
  error.slope << by_other.cross(rays.other_ray) / stddev, across / stddev;
  return error;
}

// The errors of two images' matches, and their scale.
struct EpipolarErrors {
  std::vector<EpipolarError> errors;
  FrameScale scale;
};

// Returns nullopt if too few matches have a distance, or the baseline is too short.
std::optional<EpipolarErrors> MakeErrors(const Rigid3d& cam_from_world, const Rigid3d& other_from_world,
                                         const std::vector<MatchedRays>& matches) {
  const Eigen::Vector3d baseline = CamInWorld(other_from_world) - CamInWorld(cam_from_world);
  EpipolarErrors result;
  std::vector<double> distances, focal_lengths_px;
  for (const MatchedRays& match : matches) {
    const Rays rays{cam_from_world.rotation.conjugate() * match.observation.ray_in_cam,
                    other_from_world.rotation.conjugate() * match.other_observation.ray_in_cam};
    result.errors.push_back(MakeError(match, rays, baseline, cam_from_world, other_from_world));
    focal_lengths_px.push_back(1 / RadFromPx(match.other_observation));
    const auto nearest = FindNearestPoints(rays.ray, rays.other_ray, baseline, kMinCrossingSine);
    if (nearest && nearest->AreAhead()) distances.push_back(nearest->distance1);
  }
  if (distances.size() < kMinNumMatches / 2) return std::nullopt;
  result.scale = {Median(std::move(focal_lengths_px)), HarmonicMean(distances)};
  if (!(baseline.norm() >= kMinBaselineRatio * result.scale.distance)) return std::nullopt;
  for (EpipolarError& error : result.errors) {
    error.slope.head<3>() /= result.scale.focal_length_px;
    error.slope.tail<3>() *= result.scale.distance / result.scale.focal_length_px;
  }
  return result;
}

// Sets the noise and the likelihood by the errors that remain after a deviation.
void Reweight(const std::vector<EpipolarError>& errors, const Eigen::Matrix<double, 6, 1>& deviation,
              EpipolarFit* fit) {
  std::vector<double> remaining, sizes;
  for (const EpipolarError& error : errors) {
    remaining.push_back(error.error_px + error.slope.dot(deviation));
    sizes.push_back(std::abs(remaining.back()));
  }
  fit->noise_px = std::max(StddevOfSizes(std::move(sizes)), kMinNoisePx);
  fit->information.setZero();
  fit->rhs.setZero();
  const RobustLoss loss(kLossScale);
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

std::optional<EpipolarFit> FitEpipolarErrors(const Rigid3d& cam_from_world, const Rigid3d& other_from_world,
                                             const std::vector<MatchedRays>& matches) {
  if (matches.size() < kMinNumMatches) return std::nullopt;
  const std::optional<EpipolarErrors> made = MakeErrors(cam_from_world, other_from_world, matches);
  if (!made) return std::nullopt;
  EpipolarFit fit;
  fit.scale = made->scale;
  Eigen::Matrix<double, 6, 1> deviation = Eigen::Matrix<double, 6, 1>::Zero();
  for (int i = 0; i < kNumIterations; ++i) {
    Reweight(made->errors, deviation, &fit);
    Eigen::Matrix<double, 6, 6> equations = fit.information;
    equations.diagonal().array() += 1 / (kMaxDeviationPx * kMaxDeviationPx);
    deviation = equations.ldlt().solve(fit.rhs);
  }
  if (fit.noise_px > kMaxNoisePx || !deviation.allFinite()) return std::nullopt;
  return fit;
}

}  // namespace lazyloc
