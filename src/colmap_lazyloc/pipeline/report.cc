#include "colmap_lazyloc/pipeline/report.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/confidence.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"

namespace lazyloc {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

LocalizationResult EmptyResult(const QueryImage& query, const std::string& frame_name) {
  LocalizationResult result;
  result.status = QueryStatus::LOCALIZED;
  result.query_name = query.problem.query_name;
  result.query_camera = query.problem.query_camera;
  result.intrinsics.origin = query.problem.intrinsics_origin;
  result.frame_name = frame_name;
  result.priors = UntestedPriors(query.problem.prior);
  for (const ImagePair& pair : query.problem.pairs) {
    result.pairs.push_back({pair.other_name, 0, kUnknown, kUnknown});
  }
  return result;
}

// Adds a track to the result of one of its queries, with the query's own observation and those in its database images.
void AddTrack(const Layout& layout, const Track& track, const TrackObservation& query,
              const std::vector<double>& errors_px, LocalizationResult* result) {
  const std::vector<int>& image_of_pair = layout.image_of_pair[query.image];
  PointResult point;
  point.observations.reserve(track.observations.size());
  point.point_in_world = track.point_in_world + layout.origin;
  point.query_point = query.keypoint;
  double error_sum = 0;
  int num_observations = 0;
  for (size_t i = 0; i < track.observations.size(); ++i) {
    const TrackObservation& element = track.observations[i];
    if (!layout.IsDatabase(element.image) && element.image != query.image) continue;
    error_sum += errors_px[i];
    ++num_observations;
    const auto pair = std::find(image_of_pair.begin(), image_of_pair.end(), element.image);
    if (pair != image_of_pair.end()) {
      point.observations.emplace_back(static_cast<int>(pair - image_of_pair.begin()), element.keypoint);
    }
  }
  point.mean_reprojection_error_px = error_sum / num_observations;
  result->mean_reprojection_error_px += error_sum;  // the sum, until all tracks are added
  result->num_observations += num_observations;
  ++result->num_tracks;
  result->points.push_back(std::move(point));
}

}  // namespace

Report::Report(const QueryGroup& group) : group_(group) {
  for (const QueryImage& query : group.images) {
    results_.push_back(EmptyResult(query, group.frame_names[query.frame]));
  }
}

void Report::AddPairs(const PairEstimates& estimates) {
  for (size_t query = 0; query < results_.size(); ++query) {
    for (size_t i = 0; i < results_[query].pairs.size(); ++i) {
      results_[query].pairs[i].num_inliers = estimates.num_inliers[query][i];
    }
  }
}

void Report::AddPoseErrors(const Layout& layout) {
  for (int query = 0; query < layout.num_queries; ++query) {
    results_[query].database_pose_noise = layout.expected_pose_errors[layout.FrameOf(query)].AsResult();
  }
}

void Report::AddStart(const Layout& layout, const Start& start) {
  for (int query = 0; query < layout.num_queries; ++query) {
    results_[query].start = EnumName(start.kinds[layout.FrameOf(query)]);
  }
}

void Report::AddPoses(const Layout& layout, const PosedImages& posed) {
  for (int query = 0; query < layout.num_queries; ++query) {
    LocalizationResult& result = results_[query];
    result.cam_from_world = PoseInWorld(layout, posed, query);
    result.rig_scale = posed.FrameOf(query).scale;
    Rigid3d cam_from_rig = group_.images[query].cam_from_rig;
    cam_from_rig.translation *= result.rig_scale;
    result.rig_from_world = Inverse(cam_from_rig) * result.cam_from_world;
  }
}

void Report::AddPairErrors(const Layout& layout, const Averaged& averaged, const PosedImages& posed) {
  for (size_t k = 0; k < averaged.pairs.size(); ++k) {
    const PairGeometry& pair = *averaged.pairs[k];
    if (!layout.IsDatabase(pair.other)) continue;
    const Rigid3d query = CamFromWorld(posed, pair.query), other = CamFromWorld(posed, pair.other);
    const std::vector<int>& image_of_pair = layout.image_of_pair[pair.query];
    const auto index = std::find(image_of_pair.begin(), image_of_pair.end(), pair.other) - image_of_pair.begin();
    PairResult& result = results_[pair.query].pairs[index];
    result.rotation_error_deg =
        RadToDeg(AngularDistanceRad(query.rotation, pair.query_from_other.rotation * other.rotation));
    const Eigen::Vector3d& direction = averaged.directions[k].dir_1to2_in_world;
    if (direction.isZero()) continue;
    result.direction_error_deg = RadToDeg(AngleBetweenRad(direction, CamInWorld(query) - CamInWorld(other)));
  }
}

void Report::AddRefined(const Layout& layout, const Refined& refined) {
  for (int query = 0; query < layout.num_queries; ++query) {
    results_[query].rig_error_px = refined.rig_errors_px[query];
  }
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(AsReported(layout, refined.adjustment.posed));
  std::vector<double> errors_px;
  for (const Track& track : refined.adjustment.tracks) {
    errors_px.clear();
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track.point_in_world;
      errors_px.push_back(ReprojectionError(element.observation, point_in_cam).norm());
    }
    for (const TrackObservation& element : track.observations) {
      if (layout.IsDatabase(element.image)) break;
      AddTrack(layout, track, element, errors_px, &results_[element.image]);
    }
  }
  for (LocalizationResult& result : results_) {
    result.mean_reprojection_error_px /= std::max(result.num_observations, 1);
  }
}

void Report::AddUncertainties(const std::vector<PoseUncertainty>& uncertainties) {
  for (size_t query = 0; query < results_.size(); ++query) {
    results_[query].covariance = uncertainties[query].covariance;
    results_[query].spread = uncertainties[query].spread;
  }
}

void Report::AddPriors(const std::vector<QueryPriorResult>& priors) {
  for (size_t query = 0; query < results_.size(); ++query) results_[query].priors = priors[query];
}

void Report::AddIntrinsics(const std::vector<IntrinsicsResult>& intrinsics) {
  for (size_t query = 0; query < results_.size(); ++query) results_[query].intrinsics = intrinsics[query];
}

void Report::AddEvidence(const Layout& layout, const std::vector<PoseEvidence>& evidence, double min_confidence) {
  for (int query = 0; query < layout.num_queries; ++query) {
    LocalizationResult& result = results_[query];
    result.evidence = evidence[layout.FrameOf(query)];
    result.confidence = Confidence(result.evidence);
    RequireConfidence(min_confidence, &result);
  }
}

void Report::AddCameras(const std::vector<std::optional<Camera>>& cameras) {
  for (size_t query = 0; query < results_.size(); ++query) {
    if (!cameras[query]) continue;
    results_[query].query_camera = *cameras[query];
    results_[query].is_camera_refined = true;
  }
}

void Report::AddDepths(const std::vector<DepthResult>& results) {
  for (size_t query = 0; query < results.size(); ++query) results_[query].depth = results[query];
}

void Report::AddDepthsOfPoses(const Layout& layout, const Refined& refined, const LocalizerOptions& options) {
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  for (int query = 0; query < layout.num_queries; ++query) {
    std::optional<DepthResult>& depth = results_[query].depth;
    if (!depth) continue;
    const TrackRefs& tracks = tracks_of[layout.FrameOf(query)];
    depth->num_points = CountTracksWithDepth(refined.adjustment.posed, tracks);
    depth->fixes_distance = FixDistance(refined.adjustment.posed, tracks, options);
  }
}

void Report::AddFailure(const Failure& failure) {
  for (size_t query = 0; query < results_.size(); ++query) {
    results_[query].status = failure.status;
    results_[query].reason = failure.reason;
    if (!failure.rig_errors_px.empty()) results_[query].rig_error_px = failure.rig_errors_px[query];
  }
  for (const auto& [query, partial_pose] : failure.partial_poses) results_[query].partial_pose = partial_pose;
}

std::vector<LocalizationResult> Report::Finish() && {
  for (LocalizationResult& result : results_) {
    for (const auto& [stage, seconds] : seconds_) {
      result.seconds.emplace_back(stage, seconds / static_cast<double>(results_.size()));
    }
  }
  return std::move(results_);
}

}  // namespace lazyloc
