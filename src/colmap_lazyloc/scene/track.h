#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

struct TrackObservation {
  int image = -1;     // index into PosedImages::images
  int keypoint = -1;  // of that image
  Observation observation;
  float depth = 0;  // of the point along the image's optical axis, as its depth map states it; 0: unknown
};

// One scene point and its observations: at most one per image, in ascending order of the images, so that those of
// queries come before those of database images.
struct Track {
  std::vector<TrackObservation> observations;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  double noise_ratio = 1;  // factor on the noise_px of its images; more than 1 if the database has no point of it
};

// Returns the point that the depth of an observation states; nullopt without depth, or if the image's map is not used.
std::optional<Eigen::Vector3d> PointByDepth(const Image& image, const Rigid3d& cam_from_world,
                                            const TrackObservation& element);

// Tracks that another vector owns.
using TrackRefs = std::vector<const Track*>;

}  // namespace lazyloc
