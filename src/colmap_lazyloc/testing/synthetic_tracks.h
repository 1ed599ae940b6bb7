#pragma once

#include <vector>

#include "colmap_lazyloc/scene/track.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {

struct SyntheticTracksOptions {
  int num_database = 6;
  int num_query = 1;
  int num_points = 60;
  double noise_px = 0;
  double min_views_ratio = 1;  // of the database views, that a point is at least seen in
  double focal_length_px = 500;
  uint32_t seed = 0;
};

// Views around points with exact poses, points and image points (views 0..num_query-1 are free, the others fixed).
struct SyntheticTracks {
  std::vector<View> views;
  std::vector<Track> tracks;
};

SyntheticTracks MakeSyntheticTracks(const SyntheticTracksOptions& options);

// The observation of a point by a pinhole camera of the given focal length, displaced by an offset in pixels.
Observation ObserveAt(const Eigen::Vector3d& point_in_cam, double focal_length_px, const Eigen::Vector2d& offset_px);

}  // namespace lazyloc
