#include "colmap_lazyloc/group/query_camera.h"

#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/observation.h"

namespace lazyloc {

void QueryCamera::ScaleFocalLength(double factor) {
  camera_ = WithFocalFactor(camera_, factor);
  focal_factor_ *= factor;
}

std::vector<Track> QueryCamera::Observe(const std::vector<Track>& tracks) const {
  const Observer observe(camera_);
  std::vector<Track> observed;
  for (const Track& track : tracks) {
    const std::optional<Observation> query = observe(problem_->query_keypoints[track.observations.front().keypoint]);
    if (!query) continue;
    observed.push_back(track);
    observed.back().observations.front().observation = *query;
  }
  return observed;
}

std::vector<PairGeometry> QueryCamera::Observe(std::vector<PairGeometry> pairs) const {
  const Observer observe(camera_);
  for (PairGeometry& pair : pairs) {
    std::vector<ObservedMatch> inliers = std::move(pair.inliers);
    pair.inliers.clear();
    for (const ObservedMatch& inlier : inliers) {
      const std::optional<Observation> query = observe(problem_->query_keypoints[inlier.match.query_point]);
      if (query) pair.inliers.push_back({inlier.match, *query, inlier.other});
    }
  }
  return pairs;
}

BundleAdjustmentResult QueryCamera::Take(BundleAdjustmentResult adjustment) {
  std::optional<double>& log_focal_factor = adjustment.posed.images[0].log_focal_factor;
  ScaleFocalLength(std::exp(*log_focal_factor));
  log_focal_factor = 0;
  adjustment.tracks = Observe(adjustment.tracks);
  return adjustment;
}

}  // namespace lazyloc
