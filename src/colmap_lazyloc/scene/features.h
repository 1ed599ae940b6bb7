#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// COLMAP's keypoint: position (x, y) in pixels and affine shape (a11, a12; a21, a22).
struct Keypoint {
  float x = 0, y = 0;
  float a11 = 1, a12 = 0, a21 = 0, a22 = 1;
};

// Type of the features that photos are matched by. Another type is described here, extracted in
// bridge/feature_extraction.cc and compared in matching/descriptor_matching.cc.
struct FeatureType {
  const char* name;
  int64_t colmap_type;  // in the `type` column of COLMAP 4's descriptors table
  int num_columns;      // bytes of a descriptor
};
inline constexpr FeatureType kFeatureType = {"SIFT", 0, 128};

// Descriptors with one row per keypoint.
using Descriptors = Eigen::Matrix<uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Features {
  std::vector<Keypoint> keypoints;
  Descriptors descriptors;
};

// Returns the positions of keypoints, in pixels.
inline std::vector<Eigen::Vector2d> Positions(const std::vector<Keypoint>& keypoints) {
  std::vector<Eigen::Vector2d> positions;
  positions.reserve(keypoints.size());
  for (const Keypoint& keypoint : keypoints) positions.emplace_back(keypoint.x, keypoint.y);
  return positions;
}

}  // namespace lazyloc
