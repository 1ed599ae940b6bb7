#pragma once

#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {

struct SyntheticTracksOptions {
  int num_database = 6;
  int num_query = 1;
  int num_points = 60;
  double noise_px = 0;
  double min_images_ratio = 1;  // expected part of the database images that see a point
  double focal_length_px = 500;
  uint32_t seed = 0;
};

// Single images around points, with exact poses: queries (images 0..num_query-1), then database images. Frame i carries
// image i.
struct SyntheticTracks {
  PosedImages posed;
  std::vector<Track> tracks;
};

SyntheticTracks MakeSyntheticTracks(const SyntheticTracksOptions& options);

// Gives `image` the frame of `first`, which must come before it. Both keep their poses.
void JoinFrame(int first, int image, PosedImages* posed);

// Disturbs the poses of the query frames, and the points.
void DisturbQueries(SyntheticTracks* scene, double rotation_deg, double translation, double point);

// Returns the observation of a point by a pinhole camera of the given focal length, displaced by an offset in pixels.
Observation ObserveAt(const Eigen::Vector3d& point_in_cam, double focal_length_px, const Eigen::Vector2d& offset_px);

}  // namespace lazyloc
