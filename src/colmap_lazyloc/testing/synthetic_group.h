#pragma once

#include <vector>

#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {

struct SyntheticGroupOptions {
  int num_frames = 1;
  int num_sensors = 2;  // images of a frame: a rig, or a lone image
  int num_database_images = 8;
  int num_points = 150;
  double pixel_noise_px = 0;
  double outlier_pair_ratio = 0;      // of each image's pairs: random relative pose, random matches
  double outlier_match_ratio = 0;     // within good pairs
  int num_sensors_without_pairs = 0;  // the last ones of each frame
  bool has_query_pairs = true;        // matches between the images of the group
  double calibration_error_deg = 0;   // by which the last sensor is turned against what the group says
  uint32_t seed = 0;
};

// Frames of cameras around points, in a ring with the database images; keypoint i of every image is point i.
struct SyntheticGroup {
  QueryGroup group;
  std::vector<Rigid3d> cam_from_world;  // truth, of the images
};

SyntheticGroup MakeSyntheticGroup(const SyntheticGroupOptions& options);

}  // namespace lazyloc
