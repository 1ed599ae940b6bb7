#include "colmap_lazyloc/uncertainty/pose_evidence.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/pair_fit.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Maximum differences between a pair's relative pose and a pose that it agrees with. The direction of a short baseline
// is much less certain than the rotation.
const double kMaxRotationRad = DegToRad(kMaxRotationErrorDeg), kMaxDirectionRad = DegToRad(15);
// Maximum difference of direction from a competing pose, and minimum differences of that pose from the frame's: pairs
// of short baselines scatter around the pose, and some of them agree with each other by chance.
const double kMaxCompetingDirectionRad = DegToRad(5), kMinCompetingRotationRad = DegToRad(15);
constexpr double kMinCompetingDistanceRatio = 0.1;
// Maximum number of pairs that may speak for a competing pose: the time grows with its third power.
constexpr size_t kMaxNumCompetingPairs = 30;

// Pose of a query as one of its pairs measured it: rotation, and a ray on which its centre is.
struct Vote {
  int query = -1, other = -1;
  Eigen::Quaterniond cam_from_world_rotation;
  Ray ray;  // from the other image; its direction is zero for a pair without baseline
  double num_inliers = 0;
};

std::vector<Vote> VotesOfFrame(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame) {
  std::vector<Vote> votes;
  for (const PairGeometry& pair : pairs) {
    if (!layout.IsDatabase(pair.other) || layout.FrameOf(pair.query) != frame) continue;
    const Rigid3d other = CamFromWorld(layout.given, pair.other);
    const Eigen::Quaterniond rotation = pair.query_from_other.rotation * other.rotation;
    votes.push_back({pair.query,
                     pair.other,
                     rotation,
                     {CamInWorld(other), rotation.conjugate() * -pair.query_from_other.translation},
                     static_cast<double>(pair.num_inliers)});
  }
  return votes;
}

bool Agrees(const Vote& vote, const Image& image, const Rigid3d& frame_from_world, double max_direction_rad) {
  const Rigid3d cam_from_world = CamFromWorld(image, frame_from_world);
  if (AngularDistanceRad(vote.cam_from_world_rotation, cam_from_world.rotation) > kMaxRotationRad) return false;
  const Eigen::Vector3d offset = CamInWorld(cam_from_world) - vote.ray.origin;
  return vote.ray.dir.isZero() || AngleBetweenRad(vote.ray.dir, offset) < max_direction_rad;
}

// Returns the frame's pose with the rotation of two pairs at the place where their directions cross; nullopt if their
// rotations differ, or if they belong to different images of the frame.
std::optional<Rigid3d> CompetingPose(const Layout& layout, const Vote& a, const Vote& b) {
  if (a.query != b.query) return std::nullopt;
  if (AngularDistanceRad(a.cam_from_world_rotation, b.cam_from_world_rotation) > kMaxRotationRad) return std::nullopt;
  const std::optional<Eigen::Vector3d> place = Crossing(a.ray, b.ray);
  if (!place) return std::nullopt;
  return Inverse(layout.given.images[a.query].cam_from_frame) * CamFromWorld(a.cam_from_world_rotation, *place);
}

// Returns the number of pairs that must agree on a competing pose; 0 if it is not distinct from the frame's pose. One
// at another place needs a third pair, because rays nearly always cross somewhere.
int MinNumCompetingPairs(const Rigid3d& competing, const Rigid3d& frame_from_world, double scene_distance) {
  if (AngularDistanceRad(competing.rotation, frame_from_world.rotation) > kMinCompetingRotationRad) return 2;
  const double distance = (CamInWorld(competing) - CamInWorld(frame_from_world)).norm();
  return distance > kMinCompetingDistanceRatio * scene_distance ? 3 : 0;
}

// Returns the inliers of the pairs that agree with a competing pose; 0 if there are fewer than min_num_pairs.
double CountCompeting(const Layout& layout, const std::vector<Vote>& votes, const Rigid3d& frame_from_world,
                      int min_num_pairs) {
  double num_inliers = 0;
  int num_pairs = 0;
  for (const Vote& vote : votes) {
    if (!Agrees(vote, layout.given.images[vote.query], frame_from_world, kMaxCompetingDirectionRad)) continue;
    num_inliers += vote.num_inliers;
    ++num_pairs;
  }
  return num_pairs >= min_num_pairs ? num_inliers : 0;
}

// Returns what the tracks of a frame say. num_matches: of its verified pairs with database images.
PoseEvidence MeasureTracks(const Layout& layout, const PosedImages& posed, int frame, const TrackRefs& tracks,
                           double num_matches) {
  PoseEvidence evidence;
  std::vector<double> distances, errors_px;
  double num_explained = 0;
  for (const Track* track : tracks) {
    const bool is_common = track->observations.size() > 2 || CountTracksWithDepth(posed, {track}) > 0;
    ++(is_common ? evidence.num_common_tracks : evidence.num_single_tracks);
    for (const TrackObservation& element : track->observations) {
      num_explained += layout.IsDatabase(element.image);
      if (layout.FrameOf(element.image) != frame) continue;
      const Eigen::Vector3d point_in_cam = CamFromWorld(posed, element.image) * track->point_in_world;
      distances.push_back(point_in_cam.norm());
      errors_px.push_back(ReprojectionError(element.observation, point_in_cam).norm());
    }
  }
  evidence.scene_distance = Median(std::move(distances));
  evidence.median_error_px = Median(std::move(errors_px));
  if (num_matches > 0) evidence.explained_ratio = num_explained / num_matches;
  return evidence;
}

// Returns the number of observations of each image.
std::vector<int> CountObservations(const TrackRefs& tracks, size_t num_images) {
  std::vector<int> counts(num_images, 0);
  for (const Track* track : tracks) {
    for (const TrackObservation& element : track->observations) ++counts[element.image];
  }
  return counts;
}

// Inliers of pairs by the pose that their measured relative poses speak for.
struct PairVotes {
  double num_agreeing = 0;   // with the frame's pose
  double num_competing = 0;  // with one other pose, the one that most of the others agree on
  std::optional<Rigid3d> competing_pose;
};

// Counts the votes for a frame's pose. A competing pose is one at which the measured directions of two pairs of one
// rotation cross, and distinct from the frame's pose: by its rotation, or by a distance of a tenth of the distance to
// the scene. num_explained: by image, the number of matches that the tracks of the frame's pose hold. A pair with most
// of its matches there agrees whatever its relative pose, because a plane leaves two.
PairVotes CountVotes(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame,
                     const Rigid3d& frame_from_world, double scene_distance, const std::vector<int>& num_explained) {
  PairVotes result;
  std::vector<Vote> others;
  for (const Vote& vote : VotesOfFrame(layout, pairs, frame)) {
    const bool is_explained = 2 * num_explained[vote.other] > vote.num_inliers;
    if (is_explained || Agrees(vote, layout.given.images[vote.query], frame_from_world, kMaxDirectionRad)) {
      result.num_agreeing += vote.num_inliers;
    } else if (!vote.ray.dir.isZero()) {
      others.push_back(vote);
    }
  }
  std::stable_sort(others.begin(), others.end(),
                   [](const Vote& a, const Vote& b) { return a.num_inliers > b.num_inliers; });
  if (others.size() > kMaxNumCompetingPairs) others.resize(kMaxNumCompetingPairs);
  for (size_t a = 0; a < others.size(); ++a) {
    for (size_t b = 0; b < a; ++b) {
      const std::optional<Rigid3d> competing = CompetingPose(layout, others[a], others[b]);
      if (!competing) continue;
      const int min_num_pairs = MinNumCompetingPairs(*competing, frame_from_world, scene_distance);
      if (min_num_pairs == 0) continue;
      const double num_inliers = CountCompeting(layout, others, *competing, min_num_pairs);
      if (num_inliers <= result.num_competing) continue;
      result.num_competing = num_inliers;
      result.competing_pose = competing;
    }
  }
  return result;
}

// Counts the votes for the pose of a query whose focal length was estimated: those of the pairs that fit it, because
// relative poses with another focal length say nothing.
PairVotes CountFittingPairs(const PosedImages& posed, const QueryCamera& camera,
                            const std::vector<PairGeometry>& pairs) {
  PairVotes result;
  for (const PairGeometry& pair : camera.Observe(pairs)) {
    if (FitsPoses(posed, pair)) result.num_agreeing += pair.num_inliers;
  }
  return result;
}

}  // namespace

MeasuredEvidence MeasureEvidence(const Layout& layout, const PairEstimates& estimates, const Refined& refined,
                                 const std::vector<PoseDistribution>& poses) {
  const PosedImages& posed = refined.adjustment.posed;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  MeasuredEvidence measured;
  std::vector<PoseEvidence>& evidence = measured.evidence;
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    measured.competing_poses.emplace_back();
    double num_matches = 0;
    for (const int query : layout.QueriesOf(frame)) {
      const std::vector<int>& counts = estimates.num_inliers[query];
      num_matches += std::accumulate(counts.begin(), counts.end(), 0.0);
    }
    evidence.push_back(MeasureTracks(layout, posed, frame, tracks_of[frame], num_matches));
    if (num_matches > 0) {
      const PairVotes votes =
          refined.camera
              ? CountFittingPairs(posed, *refined.camera, estimates.pairs)
              : CountVotes(layout, estimates.pairs, frame, posed.frames[frame].frame_from_world,
                           evidence.back().scene_distance, CountObservations(tracks_of[frame], posed.images.size()));
      evidence.back().agreeing_ratio = votes.num_agreeing / num_matches;
      evidence.back().competing_ratio = votes.num_competing / num_matches;
      measured.competing_poses.back() = votes.competing_pose;
    }
    // Leaves out the axis that a prior alone fixes, because it says nothing of how well the images fit together.
    const int axis = refined.unobservable_line ? 1 : 0;
    const PoseSpread spread = poses[layout.QueriesOf(frame).front()].Spread();
    evidence.back().position_stddev_ratio = spread.position_stddevs[axis] / evidence.back().scene_distance;
  }
  return measured;
}

}  // namespace lazyloc
