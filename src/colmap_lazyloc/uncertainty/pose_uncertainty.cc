#include "colmap_lazyloc/uncertainty/pose_uncertainty.h"

#include <algorithm>
#include <string>

#include "colmap_lazyloc/noise/viewpoint_errors.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

void CheckNumTracks(const std::vector<TrackRefs>& tracks_of) {
  CheckFrames(static_cast<int>(tracks_of.size()), QueryStatus::TOO_FEW_TRACKS, [&](int frame) {
    if (static_cast<int>(tracks_of[frame].size()) >= kMinNumTracks) return Reason();
    return Reason("only " + std::to_string(tracks_of[frame].size()) + " tracks agree with the refined pose; " +
                  std::to_string(kMinNumTracks) + " are needed");
  });
}

// Throws the failure of the first frame with an unobservable position, in the name of all such frames.
void CheckPositions(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                    const std::vector<TrackRefs>& tracks_of, const LocalizerOptions& options) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  std::optional<Failure> first;
  for (int i = 0; i < layout.num_query_frames; ++i) {
    const AdjustedFrame frame{
        layout, pairs, adjustment, i, tracks_of[i], refined.variance_factor, refined.has_one_orientation};
    if (!IsPositionUnobservable(frame, options)) continue;
    if (!first) first = UnobservablePositionFailure(frame);
    first->frames.push_back(i);
  }
  if (!first) return;
  if (adjustment.posed.images[0].log_focal_factor && first->cause == QueryStatus::DEGENERATE_BASELINE) {
    first->cause = QueryStatus::UNKNOWN_CAMERA;
    first->reason = kUnknownFocalLengthReason;
  }
  throw Failure(*first);
}

// Raises the variance along an unobservable line to that of the prior. The query's own noise moves it off a line of
// database images, where adjustment takes its position for observable.
void AddUnobservableLine(const UnobservableLine& line, PoseDistribution* pose) {
  const double variance = line.direction_in_world.dot(pose->PositionCovariance() * line.direction_in_world);
  const Eigen::Vector3d direction_in_cam = pose->cam_from_world.rotation * line.direction_in_world;
  pose->of_images.bottomRightCorner<3, 3>() +=
      std::max(line.variance - variance, 0.0) * direction_in_cam * direction_in_cam.transpose();
}

}  // namespace

PoseDistribution DistributionOf(const Refined& refined, int query, const Rigid3d& cam_from_world) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const IntrinsicsScore& score = adjustment.intrinsics_scores[adjustment.posed.images[query].frame];
  PoseDistribution::Matrix covariance =
      score.small_sample_factor * refined.variance_factor * adjustment.image_covariances[query] +
      adjustment.image_shared_errors[query];
  for (const auto& [group, component, variance] : refined.missing_variances) {
    covariance += variance * adjustment.prior_fits[group].component_covariances[component][query];
  }
  PoseDistribution pose = MakePoseDistribution(cam_from_world, covariance);
  if (refined.unobservable_line) AddUnobservableLine(*refined.unobservable_line, &pose);
  return pose;
}

std::vector<PoseDistribution> EstimateUncertainties(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                                                    const LocalizerOptions& options) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, adjustment.tracks);
  CheckNumTracks(tracks_of);
  CheckPositions(layout, pairs, refined, tracks_of, options);
  const PosedImages reported = RelativeToGivenDatabase(layout, adjustment.posed);
  std::vector<PoseDistribution> poses;
  for (int query = 0; query < layout.num_queries; ++query) {
    poses.push_back(DistributionOf(refined, query, CamFromWorld(reported, query)));
  }
  return poses;
}

}  // namespace lazyloc
