#include "colmap_lazyloc/loading/near_candidates.h"

#include <algorithm>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {
namespace {

constexpr size_t kNumNearest = 50;
constexpr size_t kMaxNumNear = 200;
// A position is off by at most this many standard deviations.
constexpr double kMaxErrorSigma = 3;

}  // namespace

DatabaseCandidates FindNearCandidates(const PositionPrior& position, const std::vector<DatabaseCandidate>& candidates) {
  if (candidates.size() <= kNumNearest) return {};
  const Eigen::LLT<Eigen::Matrix3d> root(position.covariance);
  std::vector<double> distances;
  for (const DatabaseCandidate& candidate : candidates) {
    const Eigen::Vector3d offset = CamInWorld(candidate.image->cam_from_world) - position.position;
    distances.push_back(root.matrixL().solve(offset).norm());
  }
  std::vector<double> sorted = distances;
  std::nth_element(sorted.begin(), sorted.begin() + (kNumNearest - 1), sorted.end());
  // Moving the photo changes each distance by at most the error, that of the image itself and of the 50th.
  const double max_distance = sorted[kNumNearest - 1] + 2 * kMaxErrorSigma;
  DatabaseCandidates near;
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (distances[i] <= max_distance) near.push_back(&candidates[i]);
  }
  if (near.size() > std::min(kMaxNumNear, candidates.size() / 2)) near.clear();
  return near;
}

}  // namespace lazyloc
