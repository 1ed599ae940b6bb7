#pragma once

#include <vector>

#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {

struct SyntheticGroupOptions {
  int num_frames = 1;
  int num_sensors = 2;  // images of each frame; 1: single images
  int num_database_images = 8;
  int num_points = 150;
  double pixel_noise_px = 0;
  double outlier_pair_ratio = 0;      // per image; an outlier pair has a random relative pose and random matches
  double outlier_match_ratio = 0;     // within each other pair; outlier matches are random
  int num_sensors_without_pairs = 0;  // the last sensors of each frame
  bool has_query_pairs = true;        // matches between the images of the group
  double calibration_error_deg = 0;   // angle between true and stated rotation of the last sensor on the rig
  // True if each num_sensors database images are a frame of the queries' rig. Its stated poses have the error of the
  // calibration.
  bool has_database_rigs = false;
  bool has_common_centre = false;  // all sensors of the rig at one point
  uint32_t seed = 0;
};

// Group of frames on a ring around points, between database images on the same ring. Keypoint i of every image is the
// projection of point i.
struct SyntheticGroup {
  QueryGroup group;
  std::vector<Rigid3d> cam_from_world;  // true pose of each image
  std::vector<Eigen::Vector3d> points_in_world;
};

SyntheticGroup MakeSyntheticGroup(const SyntheticGroupOptions& options);

}  // namespace lazyloc
