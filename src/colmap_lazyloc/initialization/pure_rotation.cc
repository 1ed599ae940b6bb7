#include "colmap_lazyloc/initialization/pure_rotation.h"

#include <algorithm>
#include <limits>
#include <map>
#include <vector>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/refinement/robust_loss.h"

namespace lazyloc {
namespace {

constexpr int kNumIterations = 10;
// Error of rotations that all database images have in common, in pixels.
constexpr double kHiddenNoisePx = 0.3;
// Maximum error of a match that agrees with the rotation, in standard deviations of its noise.
constexpr double kMaxErrorSigma = 4;

// A match as the query's observation of a direction in the world.
struct DirectionMatch {
  const Observation* query;
  int keypoint;
  Eigen::Vector3d dir_in_world;

  double ErrorPx(const Eigen::Quaterniond& rotation) const {
    return ReprojectionError(*query, rotation * dir_in_world).norm();
  }
};

std::vector<DirectionMatch> MatchesOfPair(const Layout& layout, const PairGeometry& pair) {
  const Eigen::Quaterniond world_from_other = CamFromWorld(layout.given, pair.other).rotation.conjugate();
  std::vector<DirectionMatch> matches;
  for (const ObservedMatch& inlier : pair.inliers) {
    matches.push_back(
        {&inlier.query, static_cast<int>(inlier.match.query_point), world_from_other * inlier.other.ray_in_cam});
  }
  return matches;
}

// Normal equations of a small turn.
struct Equations {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs = Eigen::Vector3d::Zero();

  Eigen::Vector3d Turn() const { return information.ldlt().solve(rhs); }
};

Equations BuildEquations(const std::vector<DirectionMatch>& matches, const Eigen::Quaterniond& rotation,
                         double noise_px) {
  const RobustLoss loss(kLossScaleSigma);
  Equations equations;
  for (const DirectionMatch& match : matches) {
    const Eigen::Vector3d direction = rotation * match.dir_in_world;
    const LinearProjection projection = ProjectionInCam(*match.query).Scaled(1 / noise_px);
    if (projection.Depth(direction) <= 0) continue;
    Eigen::Matrix<double, 2, 3> by_direction;
    const Eigen::Vector2d error = projection.Error(direction, &by_direction);
    const Eigen::Matrix<double, 2, 3> by_turn = -by_direction * Hat(direction);
    const double weight = loss.Weight(error.squaredNorm());
    equations.information += weight * by_turn.transpose() * by_turn;
    equations.rhs -= weight * by_turn.transpose() * error;
  }
  return equations;
}

// Returns the variance of the rotations that the pairs give by themselves, beyond what their matches' noise explains.
double VarianceOfPairs(const Layout& layout, const PairRefs& pairs, const Eigen::Quaterniond& rotation,
                       double noise_px) {
  double sum = 0;
  for (const PairGeometry* pair : pairs) {
    const Equations equations = BuildEquations(MatchesOfPair(layout, *pair), rotation, noise_px);
    sum += equations.Turn().squaredNorm() - equations.information.inverse().trace();
  }
  const double num_free = 3.0 * std::max(static_cast<double>(pairs.size()) - 1, 1.0);
  return pairs.size() < 2 ? 0 : std::max(sum / num_free, 0.0);
}

std::vector<double> ErrorsPx(const std::vector<DirectionMatch>& matches, const Eigen::Quaterniond& rotation) {
  std::vector<double> errors_px;
  for (const DirectionMatch& match : matches) errors_px.push_back(match.ErrorPx(rotation));
  return errors_px;
}

PoseEvidence MeasureRotationEvidence(const PairEstimates& estimates, const Averaged& averaged,
                                     const std::vector<DirectionMatch>& matches, const Eigen::Quaterniond& rotation,
                                     double noise_px) {
  double num_matches = 0, num_agreeing = 0, num_explained = 0;
  for (const int count : estimates.num_inliers[0]) num_matches += count;
  for (const PairGeometry* pair : averaged.pairs) num_agreeing += pair->num_inliers;
  std::map<int, int> num_images_of_keypoint;
  for (const DirectionMatch& match : matches) {
    if (match.ErrorPx(rotation) > kMaxErrorSigma * noise_px) continue;
    ++num_explained;
    ++num_images_of_keypoint[match.keypoint];
  }
  PoseEvidence evidence;
  evidence.num_common_tracks =
      static_cast<double>(std::count_if(num_images_of_keypoint.begin(), num_images_of_keypoint.end(),
                                        [](const auto& entry) { return entry.second > 1; }));
  evidence.explained_ratio = num_explained / num_matches;
  evidence.competing_ratio = num_matches / num_agreeing - 1;  // as if all other pairs agreed on one other rotation
  evidence.median_error_px = Median(ErrorsPx(matches, rotation));
  evidence.scene_distance = std::numeric_limits<double>::quiet_NaN();
  return evidence;
}

}  // namespace

RotationFit FitRotation(const Layout& layout, const PairEstimates& estimates, const Averaged& averaged) {
  std::vector<DirectionMatch> matches;
  for (const PairGeometry* pair : averaged.pairs) {
    const std::vector<DirectionMatch> of_pair = MatchesOfPair(layout, *pair);
    matches.insert(matches.end(), of_pair.begin(), of_pair.end());
  }
  RotationFit fit{CamFromWorld(averaged.posed, 0).rotation, {}, {}};
  Eigen::Quaterniond& rotation = fit.cam_from_world_rotation;
  double noise_px = 0;
  Equations equations;
  for (int i = 0; i < kNumIterations; ++i) {
    noise_px = std::max(StddevOfLengths(ErrorsPx(matches, rotation)), kMinImageNoisePx);
    equations = BuildEquations(matches, rotation, noise_px);
    rotation = (ExpSO3(equations.Turn()) * rotation).normalized();
  }
  const double hidden_rad = kHiddenNoisePx * RadFromPx(*matches.front().query);
  const double common_variance =
      VarianceOfPairs(layout, averaged.pairs, rotation, noise_px) / static_cast<double>(averaged.pairs.size()) +
      hidden_rad * hidden_rad;
  fit.covariance = equations.information.inverse() + common_variance * Eigen::Matrix3d::Identity();
  fit.evidence = MeasureRotationEvidence(estimates, averaged, matches, rotation, noise_px);
  return fit;
}

}  // namespace lazyloc
