#include "colmap_lazyloc/uncertainty/pose_evidence.h"

#include <numeric>
#include <utility>

#include "colmap_lazyloc/group/pair_fit.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Maximum differences between a pair's relative pose and a pose that it agrees with. The direction of a short baseline
// is much less certain than the rotation.
const double kMaxRotationRad = DegToRad(kMaxRotationErrorDeg), kMaxDirectionRad = DegToRad(15);

// Returns true if a pair's relative pose agrees with its frame's pose; without baseline, if the rotations do.
bool Agrees(const PosedImages& given, const PairGeometry& pair, const Rigid3d& frame_from_world) {
  const Rigid3d other = CamFromWorld(given, pair.other),
                query = CamFromWorld(given.images[pair.query], frame_from_world);
  const Eigen::Quaterniond rotation = pair.query_from_other.rotation * other.rotation;
  if (AngularDistanceRad(rotation, query.rotation) > kMaxRotationRad) return false;
  const Eigen::Vector3d direction = rotation.conjugate() * -pair.query_from_other.translation;
  return direction.isZero() || AngleBetweenRad(direction, CamInWorld(query) - CamInWorld(other)) < kMaxDirectionRad;
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

// Returns the number of matches in pairs that agree with a frame's pose. num_explained: by image, the number of matches
// that the tracks of the pose hold. A pair with most of its matches there agrees whatever its relative pose, because a
// plane leaves two.
double CountAgreeing(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame,
                     const Rigid3d& frame_from_world, const std::vector<int>& num_explained) {
  double num_agreeing = 0;
  for (const PairGeometry& pair : pairs) {
    if (!layout.IsDatabase(pair.other) || layout.FrameOf(pair.query) != frame) continue;
    const bool is_explained = 2 * num_explained[pair.other] > pair.num_inliers;
    if (is_explained || Agrees(layout.given, pair, frame_from_world)) num_agreeing += pair.num_inliers;
  }
  return num_agreeing;
}

// Returns the number for a query whose focal length was estimated: that of the pairs that fit the pose, because
// relative poses with another focal length say nothing.
double CountFitting(const PosedImages& posed, const QueryCamera& camera, const std::vector<PairGeometry>& pairs) {
  double num_agreeing = 0;
  for (const PairGeometry& pair : camera.Observe(pairs)) {
    if (FitsPoses(posed, pair)) num_agreeing += pair.num_inliers;
  }
  return num_agreeing;
}

}  // namespace

std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const PairEstimates& estimates, const Refined& refined,
                                          const std::vector<PoseDistribution>& poses) {
  const PosedImages& posed = refined.adjustment.posed;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  std::vector<PoseEvidence> measured;
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    double num_matches = 0;
    for (const int query : layout.QueriesOf(frame)) {
      const std::vector<int>& counts = estimates.num_inliers[query];
      num_matches += std::accumulate(counts.begin(), counts.end(), 0.0);
    }
    PoseEvidence evidence = MeasureTracks(layout, posed, frame, tracks_of[frame], num_matches);
    if (num_matches > 0) {
      const double num_agreeing =
          refined.camera ? CountFitting(posed, *refined.camera, estimates.pairs)
                         : CountAgreeing(layout, estimates.pairs, frame, posed.frames[frame].frame_from_world,
                                         CountObservations(tracks_of[frame], posed.images.size()));
      evidence.agreeing_ratio = num_agreeing / num_matches;
    }
    // Leaves out the axis that a prior alone fixes, because it says nothing of how well the images fit together.
    const int axis = refined.unobservable_line ? 1 : 0;
    const PoseSpread spread = poses[layout.QueriesOf(frame).front()].Spread();
    evidence.position_stddev_ratio = spread.position_stddevs[axis] / evidence.scene_distance;
    measured.push_back(evidence);
  }
  return measured;
}

}  // namespace lazyloc
