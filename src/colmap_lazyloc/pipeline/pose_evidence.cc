#include "colmap_lazyloc/pipeline/pose_evidence.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"

namespace lazyloc {
namespace {

// Maximum differences between a pair's relative pose and a pose that it agrees with. The direction of a short baseline
// is much less certain than the rotation.
const double kMaxRotationRad = DegToRad(5), kMaxDirectionRad = DegToRad(15);
// Maximum number of pairs that may be a rival: the time grows with its third power.
constexpr size_t kMaxNumRivalPairs = 30;
// Minimum difference of a rival from the pose: pairs of short baselines scatter around the pose, and some of them agree
// with each other by chance.
const double kMinRivalRotationRad = DegToRad(15);
constexpr double kMinRivalDistanceRatio = 0.1;
// Minimum share of a pair's matches in the tracks of a pose that the pair agrees with.
constexpr double kMinExplainedRatio = 0.5;
// Minimum number of database images with which the length of tracks tells anything: with fewer, all are short. If no
// point is seen by two database images, the number of such points says it already.
constexpr size_t kMinNumImagesForLength = 3;
// Minimum sine of the angle at which two directions cross.
constexpr double kMinCrossingSine = 0.02;

// Pose of a query as one of its pairs measured it: rotation, and a ray on which its centre is.
struct Vote {
  int query = -1, other = -1;
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Vector3d other_in_world, dir_other_to_query;  // the direction is zero for a pair without baseline
  double num_inliers = 0;
};

std::vector<Vote> VotesOfFrame(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame) {
  std::vector<Vote> votes;
  for (const PairGeometry& pair : pairs) {
    if (!layout.IsDatabase(pair.other) || layout.FrameOf(pair.query) != frame) continue;
    const Rigid3d other = CamFromWorld(layout.given, pair.other);
    const Eigen::Quaterniond rotation = pair.query_from_other.rotation * other.rotation;
    votes.push_back({pair.query, pair.other, rotation, CamInWorld(other),
                     rotation.conjugate() * -pair.query_from_other.translation, static_cast<double>(pair.num_inliers)});
  }
  return votes;
}

bool Agrees(const Vote& vote, const Image& image, const Rigid3d& frame_from_world) {
  const Rigid3d cam_from_world = CamFromWorld(image, frame_from_world);
  if (AngularDistanceRad(vote.cam_from_world_rotation, cam_from_world.rotation) > kMaxRotationRad) return false;
  const Eigen::Vector3d offset = CamInWorld(cam_from_world) - vote.other_in_world;
  return vote.dir_other_to_query.isZero() || AngleBetweenRad(vote.dir_other_to_query, offset) < kMaxDirectionRad;
}

// Returns the point nearest to two rays; nullopt if they do not cross ahead of both cameras.
std::optional<Eigen::Vector3d> Crossing(const Vote& a, const Vote& b) {
  const Eigen::Vector3d normal = a.dir_other_to_query.cross(b.dir_other_to_query);
  if (normal.norm() < kMinCrossingSine) return std::nullopt;
  const Eigen::Vector3d offset = (b.other_in_world - a.other_in_world) / normal.squaredNorm();
  const double along_a = offset.cross(b.dir_other_to_query).dot(normal);
  const double along_b = offset.cross(a.dir_other_to_query).dot(normal);
  if (along_a <= 0 || along_b <= 0) return std::nullopt;
  return (a.other_in_world + along_a * a.dir_other_to_query + b.other_in_world + along_b * b.dir_other_to_query) / 2;
}

// Returns the frame's pose with the rotation of two pairs at the place where their directions cross; nullopt if their
// rotations differ, or if they belong to different images of the frame.
std::optional<Rigid3d> RivalPose(const Layout& layout, const Vote& a, const Vote& b) {
  if (a.query != b.query) return std::nullopt;
  if (AngularDistanceRad(a.cam_from_world_rotation, b.cam_from_world_rotation) > kMaxRotationRad) return std::nullopt;
  const std::optional<Eigen::Vector3d> place = Crossing(a, b);
  if (!place) return std::nullopt;
  return Inverse(layout.given.images[a.query].cam_from_frame) * CamFromWorld(a.cam_from_world_rotation, *place);
}

// Returns the number of pairs that must agree on a rival; 0 if it is not distinct from the frame's pose.
int MinNumRivalPairs(const Rigid3d& rival, const Rigid3d& frame_from_world, double scene_distance) {
  if (AngularDistanceRad(rival.rotation, frame_from_world.rotation) > kMinRivalRotationRad) return 2;
  const double distance = (CamInWorld(rival) - CamInWorld(frame_from_world)).norm();
  return distance > kMinRivalDistanceRatio * scene_distance ? 3 : 0;
}

// Returns the inliers of the pairs that agree with a pose; 0 if there are fewer than min_num_pairs.
double Support(const Layout& layout, const std::vector<Vote>& votes, const Rigid3d& frame_from_world,
               int min_num_pairs) {
  double num_inliers = 0;
  int num_pairs = 0;
  for (const Vote& vote : votes) {
    if (!Agrees(vote, layout.given.images[vote.query], frame_from_world)) continue;
    num_inliers += vote.num_inliers;
    ++num_pairs;
  }
  return num_pairs >= min_num_pairs ? num_inliers : 0;
}

// Adds to the evidence what the tracks of the frame say. num_matches: of its verified pairs with database images.
void AddTracks(const Layout& layout, const PosedImages& posed, int frame, const TrackRefs& tracks, double num_matches,
               PoseEvidence* evidence) {
  std::vector<double> distances, errors_px;
  double num_explained = 0;
  for (const Track* track : tracks) {
    evidence->num_common_tracks += track->observations.size() > 2 || CountTracksWithDepth(posed, {track}) > 0;
    for (const TrackObservation& element : track->observations) {
      num_explained += layout.IsDatabase(element.image);
      if (layout.FrameOf(element.image) != frame) continue;
      const Eigen::Vector3d point_in_cam = CamFromWorld(posed, element.image) * track->point_in_world;
      distances.push_back(point_in_cam.norm());
      errors_px.push_back(ReprojectionError(element.observation, point_in_cam).norm());
    }
  }
  evidence->scene_distance = Median(std::move(distances));
  evidence->median_error_px = Median(std::move(errors_px));
  evidence->explained_ratio = num_matches > 0 ? num_explained / num_matches : std::numeric_limits<double>::quiet_NaN();
}

// Adds the means over the observations of the frame and of database images. cams_from_world: with the given poses of
// these, because adjustment bends them to matches that contradict the pose.
void AddMeans(const Layout& layout, const std::vector<Rigid3d>& cams_from_world, int frame, const TrackRefs& tracks,
              PoseEvidence* evidence) {
  double error_sum_px = 0;
  int num_observations = 0;
  std::set<int> database_images;
  for (const Track* track : tracks) {
    for (const TrackObservation& element : track->observations) {
      if (!layout.IsDatabase(element.image) && layout.FrameOf(element.image) != frame) continue;
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track->point_in_world;
      error_sum_px += ReprojectionError(element.observation, point_in_cam).norm();
      ++num_observations;
      if (layout.IsDatabase(element.image)) database_images.insert(element.image);
    }
  }
  evidence->mean_error_px = error_sum_px / num_observations;
  if (database_images.size() < kMinNumImagesForLength || evidence->num_common_tracks == 0) return;
  evidence->mean_track_length = num_observations / static_cast<double>(tracks.size());
}

}  // namespace

PairVotes CountVotes(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame,
                     const Rigid3d& frame_from_world, double scene_distance, const std::vector<int>& num_explained) {
  PairVotes result;
  std::vector<Vote> others;
  for (const Vote& vote : VotesOfFrame(layout, pairs, frame)) {
    const bool is_explained =
        !num_explained.empty() && num_explained[vote.other] > kMinExplainedRatio * vote.num_inliers;
    if (is_explained || Agrees(vote, layout.given.images[vote.query], frame_from_world)) {
      result.num_agreeing += vote.num_inliers;
    } else if (!vote.dir_other_to_query.isZero()) {
      others.push_back(vote);
    }
  }
  std::stable_sort(others.begin(), others.end(),
                   [](const Vote& a, const Vote& b) { return a.num_inliers > b.num_inliers; });
  if (others.size() > kMaxNumRivalPairs) others.resize(kMaxNumRivalPairs);
  for (size_t a = 0; a < others.size(); ++a) {
    for (size_t b = 0; b < a; ++b) {
      const std::optional<Rigid3d> rival = RivalPose(layout, others[a], others[b]);
      if (!rival) continue;
      const int min_num_pairs = MinNumRivalPairs(*rival, frame_from_world, scene_distance);
      if (min_num_pairs > 0) {
        result.num_rival = std::max(result.num_rival, Support(layout, others, *rival, min_num_pairs));
      }
    }
  }
  return result;
}

std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const PairEstimates& estimates, bool has_relative_poses,
                                          const PosedImages& start, const Refined& refined,
                                          const std::vector<PoseUncertainty>& uncertainties) {
  const PosedImages& posed = refined.adjustment.posed;
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(AsReported(layout, posed));
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  std::vector<PoseEvidence> evidence_of(layout.num_query_frames);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    PoseEvidence& evidence = evidence_of[frame];
    double num_matches = 0;
    for (const int query : layout.QueriesOf(frame)) {
      const std::vector<int>& counts = estimates.num_inliers[query];
      num_matches += std::accumulate(counts.begin(), counts.end(), 0.0);
    }
    AddTracks(layout, posed, frame, tracks_of[frame], refined.tried_ratio * num_matches, &evidence);
    AddMeans(layout, cams_from_world, frame, tracks_of[frame], &evidence);
    const int query = layout.QueriesOf(frame).front();
    const Eigen::Vector3d way = CamInWorld(CamFromWorld(posed, query)) - CamInWorld(CamFromWorld(start, query));
    evidence.start_distance_ratio = way.norm() / evidence.scene_distance;
    // Leaves out the axis that a prior alone fixes, because it says nothing of how well the images fit together.
    const int axis = refined.open_line ? 1 : 0;
    evidence.position_stddev_ratio = uncertainties[query].spread.position_stddevs[axis] / evidence.scene_distance;
    const double rotation_stddev_rad = uncertainties[query].spread.rotation_stddev_rad;
    evidence.rotation_stddev_deg = RadToDeg(rotation_stddev_rad);
    evidence.rotation_position_ratio = rotation_stddev_rad / evidence.position_stddev_ratio;
    if (!has_relative_poses || num_matches == 0) continue;
    std::vector<int> num_explained(posed.images.size(), 0);
    for (const Track* track : tracks_of[frame]) {
      for (const TrackObservation& element : track->observations) ++num_explained[element.image];
    }
    const PairVotes votes = CountVotes(layout, estimates.pairs, frame, posed.frames[frame].frame_from_world,
                                       evidence.scene_distance, num_explained);
    evidence.agreeing_ratio = votes.num_agreeing / num_matches;
    evidence.rival_ratio = votes.num_rival > 0 ? votes.num_rival / (votes.num_rival + votes.num_agreeing) : 0;
  }
  return evidence_of;
}

}  // namespace lazyloc
