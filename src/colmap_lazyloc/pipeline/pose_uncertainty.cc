#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

int NumDistinctCentres(const QueryState& state) {
  std::vector<Eigen::Vector3d> centres;
  for (const PairState& pair : state.pairs) {
    const Eigen::Vector3d centre = CamInWorld(state.DatabaseView(pair).cam_from_world);
    const bool is_new = std::none_of(centres.begin(), centres.end(), [&](const Eigen::Vector3d& other) {
      return (centre - other).norm() <= 1e-9 * (1 + centre.norm());
    });
    if (is_new) centres.push_back(centre);
  }
  return static_cast<int>(centres.size());
}

// The image noise must not leave the position open.
void CheckObservability(const QueryState& state) {
  const double stddev_ratio =
      RelativePoseStddev(state.adjustment.pose_covariances[0], MedianDistance(state.views[0], state.tracks));
  if (stddev_ratio <= state.options.max_position_stddev_ratio) return;
  if (NumDistinctCentres(state) == 1) {
    throw QueryFailure{QueryStatus::SCALE_UNOBSERVABLE,
                       "only one database position is usable: the distance to it cannot be known"};
  }
  throw QueryFailure{QueryStatus::DEGENERATE_BASELINE,
                     "the position is open along a line: no point is seen from two database images apart"};
}

}  // namespace

void EstimateCovariance(QueryState* state) {
  if (static_cast<int>(state->tracks.size()) < state->options.min_num_tracks) {
    throw QueryFailure{QueryStatus::TOO_FEW_TRACKS, "only " + std::to_string(state->tracks.size()) +
                                                        " tracks agree with the refined pose; " +
                                                        std::to_string(state->options.min_num_tracks) + " are needed"};
  }
  CheckObservability(*state);
  const double variance_factor =
      VarianceFactor(state->views, state->tracks, state->options.bundle_adjustment.loss_scale_sigma);
  // Into the tangent of the pose in the database's own frame: t = t_local - R origin.
  Eigen::Matrix<double, 6, 6> world_from_local = Eigen::Matrix<double, 6, 6>::Identity();
  world_from_local.bottomLeftCorner<3, 3>() = Hat(state->views[0].cam_from_world.rotation * state->origin);
  const Eigen::Matrix<double, 6, 6> moved =
      variance_factor * world_from_local * state->adjustment.pose_covariances[0] * world_from_local.transpose();
  state->result.covariance = (moved + moved.transpose()) / 2;
}

}  // namespace lazyloc
