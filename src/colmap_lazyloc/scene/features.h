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

// Descriptors with one row per keypoint. Those of SIFT have 128 columns.
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
