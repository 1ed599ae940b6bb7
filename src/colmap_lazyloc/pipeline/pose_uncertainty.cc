#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

// Throws for the first kind of failure that there is, with all of the frames that have it.
void CheckPositions(double variance_factor, QueryState* state) {
  const bool is_single = state->frames.size() == 1;  // which sees them all
  std::vector<std::vector<Track>> tracks_by_frame;
  if (!is_single) tracks_by_frame = state->TracksByFrame(state->tracks);
  std::vector<QueryFailure> failures;
  for (const int frame : state->frames) {
    const std::vector<Track>& tracks = is_single ? state->tracks : tracks_by_frame[frame];
    if (!IsPositionOpen(*state, frame, tracks)) continue;
    QueryFailure failure = FailWithOpenPosition(frame, tracks, variance_factor, state);
    if (state->SeeksFocalLength() && failure.status == QueryStatus::DEGENERATE_BASELINE) {
      failure.reason = "the position is open along a line: its distance and the focal length cannot be told apart";
    }
    failures.push_back(failure);
    failures.front().frames.push_back(frame);
  }
  if (!failures.empty()) throw failures.front();
}

// Into the tangent of the pose in the database's own frame: t = t_local - R origin.
Eigen::Matrix<double, 6, 6> MoveToWorld(const Eigen::Matrix<double, 6, 6>& covariance, const Eigen::Vector3d& origin,
                                        const Rigid3d& pose) {
  Eigen::Matrix<double, 6, 6> world_from_local = Eigen::Matrix<double, 6, 6>::Identity();
  world_from_local.bottomLeftCorner<3, 3>() = Hat(pose.rotation * origin);
  const Eigen::Matrix<double, 6, 6> moved = world_from_local * covariance * world_from_local.transpose();
  return (moved + moved.transpose()) / 2;
}

}  // namespace

void EstimateCovariance(QueryState* state) {
  const std::vector<int> num_tracks = state->NumTracksByFrame(state->tracks);
  CheckFrames(*state, QueryStatus::TOO_FEW_TRACKS, [&](int frame) -> std::optional<std::string> {
    if (num_tracks[frame] >= state->options.min_num_tracks) return std::nullopt;
    return "only " + std::to_string(num_tracks[frame]) + " tracks agree with the refined pose; " +
           std::to_string(state->options.min_num_tracks) + " are needed";
  });
  const double factor = VarianceFactor(state->views, state->tracks, state->options.bundle_adjustment.loss_scale_sigma);
  CheckPositions(factor, state);
  const double missing_prior_factor = std::max(state->adjustment.prior_fit.VarianceFactor(factor) - factor, 0.0);
  for (int query = 0; query < state->NumQueries(); ++query) {
    const Rigid3d& pose = state->views[query].cam_from_world;
    const Eigen::Matrix<double, 6, 6> covariance = factor * state->adjustment.pose_covariances[query] +
                                                   missing_prior_factor * state->adjustment.prior_parts[query];
    state->results[query].spread = ComputePoseSpread(pose, covariance);
    state->results[query].covariance = MoveToWorld(covariance, state->origin, pose);
  }
}

}  // namespace lazyloc
