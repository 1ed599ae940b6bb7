#include "colmap_lazyloc/priors/plane_orientation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/LU>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/priors/prior_comparison.h"
#include "colmap_lazyloc/refinement/sampson_refinement.h"
#include "colmap_lazyloc/scene/epipolar_error.h"
#include "colmap_lazyloc/scene/plane_fit.h"
#include "colmap_lazyloc/uncertainty/pose_uncertainty.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Errors of more standard deviations are not chance; bearings that differ by less are the same.
constexpr double kMaxErrorSigma = 3;
// Minimum noise of keypoints in pixels: smaller errors are chance.
constexpr double kMinNoisePx = 0.3;
// Variance of the sum of squared errors over that of independent ones, because keypoints that are near each other err
// alike: with the noisy points of a plane, the sums of both orientations differ by up to 50.
constexpr double kSharedErrorFactor = 10;
// Bearings that differ by less are the same however exact they are, in rad.
constexpr double kMaxEqualRad = 0.01;

EpipolarError ErrorOf(const Rigid3d& query_from_database, const Track& match) {
  return MeasureEpipolarError(query_from_database, match.observations.front().observation,
                              match.observations.back().observation);
}

// How well one of two orientations fits: the standard deviation of its bearing, if any, and how much the priors of a
// query contradict it.
struct OrientationFit {
  double bearing_stddev_rad = 0;
  double prior_error = 0;  // squared sigmas, truncated where a prior is left out
};

OrientationFit MeasureOrientation(const Layout& layout, const PairRefs& pairs, const Refined& refined) {
  const std::vector<TrackRefs> tracks = TracksByFrame(layout, refined.adjustment.tracks);
  const AdjustedFrame frame{layout,
                            pairs,
                            refined.adjustment,
                            0,
                            tracks[0],
                            refined.variance_factor,
                            /*has_one_orientation=*/true};
  const PartialPose partial = UnobservablePositionFailure(frame).partial_poses.at(0);
  OrientationFit fit{partial.bearing ? partial.bearing->stddev_rad : 0};
  const auto add = [&](const PriorComparison& comparison) {
    fit.prior_error += std::min(std::pow(comparison.result.deviation_sigma, 2), kContradictionOfTwo);
  };
  const QueryPrior& prior = layout.priors[0];
  if (prior.position && partial.bearing) {
    const Eigen::Vector3d from = CamInWorld(CamFromWorld(layout.given, pairs.front()->other));
    add(CompareWithRay(*prior.position, {from, partial.bearing->dir_database_to_query_in_world},
                       partial.bearing->stddev_rad)
            .comparison);
  }
  if (prior.gravity) {
    const PoseDistribution pose = DistributionOf(refined, 0, CamFromWorld(refined.adjustment.posed, 0));
    add(CompareGravity(*prior.gravity, partial.cam_from_world_rotation, pose.RotationCovariance()));
  }
  return fit;
}

// Returns the relative pose (query from database) that fits all matches best near a refined one, because refinement may
// end before that.
Rigid3d SettledPose(const PairRefs& pairs, const Refined& refined, const std::vector<Track>& matches) {
  const PosedImages posed = RefineBySampsonError(refined.adjustment.posed, matches).posed;
  return CamFromWorld(posed, 0) * Inverse(CamFromWorld(posed, pairs.front()->other));
}

}  // namespace

std::optional<Rigid3d> OtherOrientation(const Rigid3d& query_from_world, const Rigid3d& database_from_world,
                                        const TrackRefs& tracks) {
  const PlaneFit plane = FitPlane(query_from_world, tracks);
  // The plane's homography is R (I + a b^T) with the relative pose (R, R a) and b the plane's normal over its distance.
  // Its square is I + b c^T + c b^T, in which b and c may change places.
  const Rigid3d database_from_query = database_from_world * Inverse(query_from_world);
  const Eigen::Matrix3d rotation = database_from_query.rotation.toRotationMatrix();
  const Eigen::Vector3d a = rotation.transpose() * database_from_query.translation;
  const Eigen::Vector3d& b = plane.normal;
  const Eigen::Vector3d c = a + a.squaredNorm() / 2 * b;
  Eigen::Vector3d other_b = b.norm() / c.norm() * c;  // with this length, the other a is as long as a
  Eigen::Vector3d other_a = c.norm() / b.norm() * (b - a.squaredNorm() * b.squaredNorm() / (2 * c.squaredNorm()) * c);
  const Eigen::VectorXd in_front = plane.rays * other_b;
  if (!in_front.allFinite()) return std::nullopt;
  const Eigen::Index num_in_front = (in_front.array() > 0).count();
  if (2 * num_in_front < in_front.size()) {
    other_a *= -1;
    other_b *= -1;
  }
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d other_rotation =
      rotation * (identity + a * b.transpose()) * (identity + other_a * other_b.transpose()).inverse();
  const Eigen::Quaterniond quaternion = Eigen::Quaterniond(other_rotation).normalized();
  if (!quaternion.coeffs().allFinite()) return std::nullopt;
  return Inverse(Rigid3d{quaternion, quaternion * other_a}) * database_from_world;
}

double SumSquaredErrors(const Rigid3d& query_from_database, const std::vector<Track>& matches, double noise_px) {
  double sum = 0;
  for (const Track& match : matches) {
    const double squared_px = ErrorOf(query_from_database, match).squared_px;
    sum += std::min(squared_px / (noise_px * noise_px), kMaxErrorSigma * kMaxErrorSigma);
  }
  return sum;
}

double EpipolarNoisePx(const Rigid3d& query_from_database, const std::vector<Track>& matches) {
  std::vector<double> errors_px;
  for (const Track& match : matches) {
    const EpipolarError error = ErrorOf(query_from_database, match);
    if (error.is_in_front) errors_px.push_back(std::sqrt(error.squared_px));
  }
  return errors_px.empty() ? kMinNoisePx : std::max(StddevOfSizes(std::move(errors_px)), kMinNoisePx);
}

std::optional<double> CompareOrientations(const Layout& layout, const PairRefs& pairs,
                                          const std::vector<Track>& matches, const Refined& refined,
                                          const Refined& other) {
  const Rigid3d pose = SettledPose(pairs, refined, matches), other_pose = SettledPose(pairs, other, matches);
  const OrientationFit fit = MeasureOrientation(layout, pairs, refined),
                       other_fit = MeasureOrientation(layout, pairs, other);
  const double angle_rad = AngleBetweenRad(CamInWorld(pose), CamInWorld(other_pose));
  if (angle_rad <= std::max(kMaxErrorSigma * fit.bearing_stddev_rad, kMaxEqualRad)) return std::nullopt;
  const double noise_px = std::min(EpipolarNoisePx(pose, matches), EpipolarNoisePx(other_pose, matches));
  const double by_matches = SumSquaredErrors(other_pose, matches, noise_px) - SumSquaredErrors(pose, matches, noise_px);
  return by_matches / kSharedErrorFactor + other_fit.prior_error - fit.prior_error;
}

}  // namespace lazyloc
