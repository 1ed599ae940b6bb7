#include "colmap_lazyloc/uncertainty/evidence_measurement.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Returns what the tracks of a frame say. num_matches: of its verified pairs with database images.
PoseEvidence MeasureTracks(const Layout& layout, const PosedImages& posed, int frame, const TrackRefs& tracks,
                           double num_matches) {
  PoseEvidence evidence;
  std::vector<double> distances, errors_px;
  double num_explained = 0;
  for (const Track* track : tracks) {
    const auto is_query = [&](const TrackObservation& element) { return !layout.IsDatabase(element.image); };
    const auto num_queries = std::count_if(track->observations.begin(), track->observations.end(), is_query);
    const auto num_others = static_cast<std::ptrdiff_t>(track->observations.size()) - num_queries;
    // Database images that see a point from one direction say no more than one of them.
    const auto num_views =
        num_queries + (track->noise_ratio > 1 ? std::min<std::ptrdiff_t>(num_others, 1) : num_others);
    const bool is_common = num_views > 2 || CountTracksWithDepth(posed, {track}) > 0;
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

}  // namespace

std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const std::vector<std::vector<int>>& num_inliers,
                                          const Refined& refined, const std::vector<PoseDistribution>& poses) {
  const PosedImages& posed = refined.adjustment.posed;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  std::vector<PoseEvidence> measured;
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    double num_matches = 0;
    for (const int query : layout.QueriesOf(frame)) {
      num_matches += std::accumulate(num_inliers[query].begin(), num_inliers[query].end(), 0.0);
    }
    PoseEvidence evidence = MeasureTracks(layout, posed, frame, tracks_of[frame], num_matches);
    // Leaves out the axis that a prior alone fixes, because it says nothing of how well the images fit together.
    const int axis = refined.unobservable_line ? 1 : 0;
    const PoseSpread spread = poses[layout.QueriesOf(frame).front()].Spread();
    evidence.position_stddev_ratio = spread.position_stddevs[axis] / evidence.scene_distance;
    measured.push_back(evidence);
  }
  return measured;
}

}  // namespace lazyloc
