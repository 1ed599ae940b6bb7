#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {

void EstimateCovariance(QueryState* state) {
  if (static_cast<int>(state->tracks.size()) < state->options.min_num_tracks) {
    throw QueryFailure{QueryStatus::TOO_FEW_TRACKS, "only " + std::to_string(state->tracks.size()) +
                                                        " tracks agree with the refined pose; " +
                                                        std::to_string(state->options.min_num_tracks) + " are needed"};
  }
  const double factor = VarianceFactor(state->views, state->tracks, state->options.bundle_adjustment.loss_scale_sigma);
  const Eigen::Matrix<double, 6, 6> covariance = factor * state->adjustment.pose_covariances[0];
  if (IsPositionOpen(*state)) {
    QueryFailure failure = FailWithOpenPosition(covariance, state);
    if (state->SeeksFocalLength() && failure.status == QueryStatus::DEGENERATE_BASELINE) {
      failure.reason = "the position is open along a line: its distance and the focal length cannot be told apart";
    }
    throw failure;
  }
  const Rigid3d& pose = state->views[0].cam_from_world;
  state->result.spread = ComputePoseSpread(pose, covariance);
  // Into the tangent of the pose in the database's own frame: t = t_local - R origin.
  Eigen::Matrix<double, 6, 6> world_from_local = Eigen::Matrix<double, 6, 6>::Identity();
  world_from_local.bottomLeftCorner<3, 3>() = Hat(pose.rotation * state->origin);
  const Eigen::Matrix<double, 6, 6> moved = world_from_local * covariance * world_from_local.transpose();
  state->result.covariance = (moved + moved.transpose()) / 2;
}

}  // namespace lazyloc
