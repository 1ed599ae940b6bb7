#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

#include <algorithm>
#include <string>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/refinement/covariance.h"

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
    if (!IsPositionOpen(frame, options)) continue;
    if (!first) first = OpenPositionFailure(frame, refined.variance_factor);
    first->frames.push_back(i);
  }
  if (!first) return;
  if (adjustment.posed.images[0].log_focal_factor && first->cause == QueryStatus::DEGENERATE_BASELINE) {
    first->cause = QueryStatus::UNKNOWN_CAMERA;
    first->reason =
        "the images do not determine the focal length, which nobody has stated: it cannot be told apart from the "
        "distance to the scene";
  }
  throw Failure(*first);
}

// Raises the variance along a line that the images leave open to that of the prior. The query's own noise moves it off
// a line of database images, where adjustment takes it for observable.
void AddOpenLine(const OpenLine& line, const Rigid3d& cam_from_world, Eigen::Matrix<double, 6, 6>* covariance) {
  const Eigen::Vector3d& direction = line.direction_in_world;
  const double variance = direction.dot(PositionCovariance(cam_from_world, *covariance) * direction);
  const Eigen::Vector3d direction_in_cam = cam_from_world.rotation * direction;
  covariance->bottomRightCorner<3, 3>() +=
      std::max(line.variance - variance, 0.0) * direction_in_cam * direction_in_cam.transpose();
}

}  // namespace

Eigen::Matrix<double, 6, 6> TotalCovariance(const Refined& refined, int query) {
  Eigen::Matrix<double, 6, 6> covariance = refined.variance_factor * refined.adjustment.image_covariances[query] +
                                           refined.adjustment.image_shared_errors[query];
  for (const auto& [group, component, variance] : refined.missing_variances) {
    covariance += variance * refined.adjustment.prior_fits[group].image_parts[component][query];
  }
  if (refined.open_line) AddOpenLine(*refined.open_line, CamFromWorld(refined.adjustment.posed, query), &covariance);
  return covariance;
}

Eigen::Matrix<double, 6, 6> TangentFromAround(const Eigen::Vector3d& origin, const Eigen::Quaterniond& rotation) {
  Eigen::Matrix<double, 6, 6> derivative = Eigen::Matrix<double, 6, 6>::Identity();
  derivative.bottomLeftCorner<3, 3>() = Hat(rotation * origin);
  return derivative;
}

Eigen::Matrix<double, 6, 6> CovarianceFromAround(const Eigen::Vector3d& origin, const Eigen::Quaterniond& rotation,
                                                 const Eigen::Matrix<double, 6, 6>& covariance) {
  const Eigen::Matrix<double, 6, 6> derivative = TangentFromAround(origin, rotation);
  const Eigen::Matrix<double, 6, 6> moved = derivative * covariance * derivative.transpose();
  return (moved + moved.transpose()) / 2;
}

std::vector<PoseUncertainty> EstimateUncertainties(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                                                   const LocalizerOptions& options) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, adjustment.tracks);
  CheckNumTracks(tracks_of);
  CheckPositions(layout, pairs, refined, tracks_of, options);
  const PosedImages reported = AsReported(layout, adjustment.posed);
  std::vector<PoseUncertainty> uncertainties;
  for (int query = 0; query < layout.num_queries; ++query) {
    const Rigid3d pose = CamFromWorld(reported, query);
    const Eigen::Matrix<double, 6, 6> covariance = TotalCovariance(refined, query);
    uncertainties.push_back(
        {CovarianceFromAround(layout.origin, pose.rotation, covariance), ComputePoseSpread(pose, covariance)});
  }
  return uncertainties;
}

}  // namespace lazyloc
