#include "colmap_lazyloc/pipeline/make_record.h"

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/uncertainty/confidence.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

using Results = std::vector<LocalizationResult>;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Returns the result of a query without anything that is known of its pose.
LocalizationResult MakeEmptyResult(const Choice& choice, int query) {
  const Solution& solution = *choice.solution;
  const Prepared& prepared = *solution.prepared;
  const QueryImage& image = prepared.group.images[query];
  LocalizationResult result;
  result.query_name = image.problem.query_name;
  result.query_camera = image.problem.query_camera;
  result.frame_name = prepared.group.frame_names[image.frame];
  result.rig_scale = image.rig_scale;
  result.intrinsics = choice.intrinsics[query];
  result.priors = choice.priors[query];
  if (!solution.depths.empty()) result.depth = solution.depths[query];
  if (!solution.starts.empty()) result.start = EnumName(solution.starts[image.frame]);
  // Rotations alone are not adjusted to database poses.
  const std::vector<ExpectedPoseErrors>& expected = prepared.layout.expected_pose_errors;
  if (!expected.empty() && solution.hypothesis.approach != Approach::ROTATION) {
    result.database_pose_noise = expected[image.frame].AsResult();
  }
  for (size_t i = 0; i < image.problem.pairs.size(); ++i) {
    const int num_inliers = prepared.failure ? 0 : prepared.estimates.num_inliers[query][i];
    result.pairs.push_back({image.problem.pairs[i].other_name, num_inliers, kUnknown, kUnknown});
  }
  return result;
}

// Adds the pose of a query with its camera and covariance.
void AddPose(const Choice& choice, int query, LocalizationResult* result) {
  const Layout& layout = choice.solution->prepared->layout;
  const CheckedIntrinsics& checked = choice.solution->checked;
  result->cam_from_world = PoseInWorld(layout, checked.posed, query);
  const double scale = checked.posed.FrameOf(query).scale;
  Rigid3d cam_from_rig = choice.solution->prepared->group.images[query].cam_from_rig;
  cam_from_rig.translation *= scale;
  result->rig_scale *= scale;
  result->rig_from_world = Inverse(cam_from_rig) * result->cam_from_world;
  if (!checked.cameras.empty() && checked.cameras[query]) {
    result->query_camera = *checked.cameras[query];
    result->is_camera_refined = true;
  }
  PoseDistribution pose = checked.poses[query];
  pose.log_focal_variance += std::max(choice.extra_log_focal_variance, 0.0);
  result->covariance = pose.CovarianceAt(result->cam_from_world.translation);
  result->spread = pose.Spread();
}

// Adds the deviations of the pairs' rotations and directions from the adjusted poses.
void AddPairErrors(const Solution& solution, Results* results) {
  const Layout& layout = solution.prepared->layout;
  const PosedImages& posed = solution.refined ? solution.refined->adjustment.posed : solution.checked.posed;
  for (size_t k = 0; k < solution.averaged.pairs.size(); ++k) {
    const PairGeometry& pair = *solution.averaged.pairs[k];
    if (!layout.IsDatabase(pair.other)) continue;
    const Rigid3d query = CamFromWorld(posed, pair.query), other = CamFromWorld(posed, pair.other);
    const std::vector<int>& image_of_pair = layout.image_of_pair[pair.query];
    const auto index = std::find(image_of_pair.begin(), image_of_pair.end(), pair.other) - image_of_pair.begin();
    PairResult& result = (*results)[pair.query].pairs[index];
    result.rotation_error_deg =
        RadToDeg(AngularDistanceRad(query.rotation, pair.query_from_other.rotation * other.rotation));
    const Eigen::Vector3d& direction = solution.averaged.directions[k].dir_1to2_in_world;
    if (direction.isZero()) continue;
    result.direction_error_deg = RadToDeg(AngleBetweenRad(direction, CamInWorld(query) - CamInWorld(other)));
  }
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

// Adds the tracks of the last adjustment, with errors against the database as given.
void AddTracks(const Layout& layout, const BundleAdjustmentResult& adjustment, Results* results) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(RelativeToGivenDatabase(layout, adjustment.posed));
  std::vector<double> errors_px;
  for (const Track& track : adjustment.tracks) {
    errors_px.clear();
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track.point_in_world;
      errors_px.push_back(ReprojectionError(element.observation, point_in_cam).norm());
    }
    for (const TrackObservation& element : track.observations) {
      if (layout.IsDatabase(element.image)) break;
      AddTrack(layout, track, element, errors_px, &(*results)[element.image]);
    }
  }
  for (LocalizationResult& result : *results) {
    result.mean_reprojection_error_px /= std::max(result.num_observations, 1);
  }
}

// Adds what the last adjustment contributes beside the poses.
void AddRefined(const Solution& solution, Results* results) {
  const Layout& layout = solution.prepared->layout;
  const Refined& refined = *solution.refined;
  AddTracks(layout, refined.adjustment, results);
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  for (int query = 0; query < layout.num_queries; ++query) {
    LocalizationResult& result = (*results)[query];
    result.rig_error_px = refined.rig_errors_px[query];
    if (!result.depth) continue;
    const TrackRefs& tracks = tracks_of[layout.FrameOf(query)];
    result.depth->num_points = CountTracksWithDepth(refined.adjustment.posed, tracks);
    result.depth->fixes_distance = FixDistance(refined.adjustment.posed, tracks);
  }
}

// Returns what the solution beside the chosen one assumes of the focal length.
std::string Explanation(const Solution& other) {
  const IntrinsicsResult& intrinsics = other.checked.results.front();
  const Camera& camera = other.prepared->group.images.front().problem.query_camera;
  if (other.hypothesis.estimates_focal_length) {
    return Format("the focal length is %.1f px, as the images suggest",
                  intrinsics.focal_factor * MeanFocalLength(camera));
  }
  return Format("the focal length is %.1f px (origin: %s)", MeanFocalLength(camera), EnumName(intrinsics.origin));
}

// Adds the more probable of the competing pose and the other solution.
void AddRunnerUp(const Choice& choice, int query, LocalizationResult* result) {
  const Solution& solution = *choice.solution;
  const int frame = solution.prepared->group.images[query].frame;
  const std::optional<Rigid3d>& competing_pose = solution.competing_poses[frame];
  if (competing_pose) {
    PosedImages posed = solution.checked.posed;
    posed.frames[frame].frame_from_world = *competing_pose;
    result->runner_up =
        RunnerUp{Format("points that do not fit the pose agree on this one, with %.0f %% of its score",
                        100 * result->evidence.competing_ratio),
                 PoseInWorld(solution.prepared->layout, posed, query), OddsOfCompetingPose(result->evidence)};
  }
  if (choice.runner_up == nullptr) return;
  const Solution& other = *choice.runner_up;
  const double odds = OddsOfWrong(*result->confidence) / OddsOfWrong(Confidence(other.evidence[frame]));
  if (result->runner_up && result->runner_up->odds > odds) return;
  result->runner_up =
      RunnerUp{Explanation(other), PoseInWorld(other.prepared->layout, other.checked.posed, query), odds};
}

void Refuse(const Refusal& refusal, LocalizationResult* result) {
  result->status = refusal.status;
  result->reason = refusal.reason;
}

// Sets the confidence with the runner-up, the status and its reason.
void Conclude(const Choice& choice, int query, const LocalizerOptions& options, LocalizationResult* result) {
  const Solution& solution = *choice.solution;
  const int frame = solution.prepared->group.images[query].frame;
  if (!solution.evidence.empty()) {
    result->evidence = solution.evidence[frame];
    result->confidence = Confidence(result->evidence);
    AddRunnerUp(choice, query, result);
  }
  if (const std::optional<Refusal> refusal = RefusalOf(choice, query, options)) {
    Refuse(*refusal, result);
  } else {
    result->status = QueryStatus::LOCALIZED;
  }
}

}  // namespace

Results MakeResults(const Choice& choice, const LocalizerOptions& options) {
  const Solution& solution = *choice.solution;
  Results results;
  for (int query = 0; query < static_cast<int>(solution.prepared->group.images.size()); ++query) {
    results.push_back(MakeEmptyResult(choice, query));
    if (!choice.failure) AddPose(choice, query, &results.back());
    Conclude(choice, query, options, &results.back());
  }
  if (choice.failure) {
    const Failure& failure = *choice.failure;
    for (size_t query = 0; query < failure.rig_errors_px.size(); ++query) {
      results[query].rig_error_px = failure.rig_errors_px[query];
    }
    for (const auto& [query, partial_pose] : failure.partial_poses) results[query].partial_pose = partial_pose;
    return results;
  }
  if (!solution.hypothesis.estimates_focal_length) AddPairErrors(solution, &results);
  if (solution.refined) AddRefined(solution, &results);
  return results;
}

Results MakeResults(const std::vector<ImageChoice>& images, const LocalizerOptions& options) {
  Results results(images.size());
  std::map<const Choice*, Results> results_of;  // of all queries of a solution
  for (size_t i = 0; i < images.size(); ++i) {
    Results& together = results_of[images[i].choice.get()];
    if (together.empty()) together = MakeResults(*images[i].choice, options);
    results[i] = std::move(together[images[i].query]);
    results[i].seconds = images[i].seconds;
  }
  return results;
}

void AddResult(LocalizationResult result, QueryRecord* record) {
  record->result = std::move(result);
  for (const auto& [stage, seconds] : record->result.seconds) StageTimer::Add(stage, seconds, &record->seconds);
  const std::vector<std::string>& damages = record->damages;
  if (damages.empty() || record->result.status == QueryStatus::LOCALIZED) return;
  if (record->result.status == QueryStatus::NO_PAIRS) record->result.status = QueryStatus::DAMAGED_DATA;
  const std::string more = damages.size() > 1 ? " (" + std::to_string(damages.size()) + " damaged records)" : "";
  std::string& reason = record->result.reason;
  reason += (reason.empty() ? "left out: " : "; left out: ") + damages.front() + more;
}

void AddRefusal(const Refusal& refusal, QueryRecord* record) { Refuse(refusal, &record->result); }

}  // namespace lazyloc
