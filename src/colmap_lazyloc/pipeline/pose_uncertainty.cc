#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

#include <algorithm>
#include <string>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/database_priors.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

void CheckNumTracks(const std::vector<TrackRefs>& tracks_of, int min_num_tracks) {
  CheckFrames(static_cast<int>(tracks_of.size()), QueryStatus::TOO_FEW_TRACKS, [&](int frame) {
    if (static_cast<int>(tracks_of[frame].size()) >= min_num_tracks) return Reason();
    return Reason("only " + std::to_string(tracks_of[frame].size()) + " tracks agree with the refined pose; " +
                  std::to_string(min_num_tracks) + " are needed");
  });
}

// Throws the failure of the first frame with an unobservable position, in the name of all such frames.
void CheckPositions(const Layout& layout, const PairRefs& pairs, const BundleAdjustmentResult& adjustment,
                    const std::vector<TrackRefs>& tracks_of, double variance_factor, const LocalizerOptions& options) {
  std::optional<Failure> first;
  for (int i = 0; i < layout.num_query_frames; ++i) {
    const AdjustedFrame frame{layout, pairs, adjustment, i, tracks_of[i]};
    if (!IsPositionOpen(frame, options)) continue;
    if (!first) first = OpenPositionFailure(frame, variance_factor);
    first->frames.push_back(i);
  }
  if (!first) return;
  if (adjustment.posed.images[0].log_focal_factor && first->status == QueryStatus::DEGENERATE_BASELINE) {
    first->status = QueryStatus::UNKNOWN_CAMERA;
    first->reason =
        "the images do not determine the focal length, which nobody has stated: it cannot be told apart from the "
        "distance to the scene";
  }
  throw Failure(*first);
}

// Returns the covariance of cam_from_world, with the variances of image noise and database poses that the adjustment
// shows instead of those that it took for granted.
Eigen::Matrix<double, 6, 6> TotalCovariance(const BundleAdjustmentResult& adjustment, int query, double factor) {
  Eigen::Matrix<double, 6, 6> covariance = factor * adjustment.image_covariances[query];
  ForEachMissingVariance(adjustment, factor, [&](size_t group, size_t component, double variance) {
    covariance += variance * adjustment.prior_fits[group].image_parts[component][query];
  });
  return covariance;
}

// Moves a covariance into the tangent of the pose in the database's coordinates: t = t_local - R origin.
Eigen::Matrix<double, 6, 6> MoveToWorld(const Eigen::Matrix<double, 6, 6>& covariance, const Eigen::Vector3d& origin,
                                        const Rigid3d& pose) {
  Eigen::Matrix<double, 6, 6> world_from_local = Eigen::Matrix<double, 6, 6>::Identity();
  world_from_local.bottomLeftCorner<3, 3>() = Hat(pose.rotation * origin);
  const Eigen::Matrix<double, 6, 6> moved = world_from_local * covariance * world_from_local.transpose();
  return (moved + moved.transpose()) / 2;
}

}  // namespace

std::vector<PoseUncertainty> EstimateUncertainties(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                                                   const LocalizerOptions& options) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, adjustment.tracks);
  CheckNumTracks(tracks_of, options.min_num_tracks);
  const double factor =
      VarianceFactor(adjustment.posed, adjustment.tracks, RobustLoss(options.bundle_adjustment.loss_scale_sigma));
  CheckPositions(layout, pairs, adjustment, tracks_of, factor, options);
  const PosedImages reported = AsReported(layout, adjustment.posed);
  std::vector<PoseUncertainty> uncertainties;
  for (int query = 0; query < layout.num_queries; ++query) {
    const Rigid3d pose = CamFromWorld(reported, query);
    const Eigen::Matrix<double, 6, 6> covariance = TotalCovariance(adjustment, query, factor);
    uncertainties.push_back({MoveToWorld(covariance, layout.origin, pose), ComputePoseSpread(pose, covariance)});
  }
  return uncertainties;
}

}  // namespace lazyloc
