#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// COLMAP's keypoint: position (x, y) in pixels and affine shape (a11, a12; a21, a22).
struct Keypoint {
  float x = 0, y = 0;
  float a11 = 1, a12 = 0, a21 = 0, a22 = 1;
};

// What features are, numbered as in the column `type` of COLMAP 4's table descriptors. Older versions know SIFT alone.
enum class FeatureType { SIFT, ALIKED_N16ROT, ALIKED_N32, LOMA_B, LOMA_B128 };
template <>
inline constexpr std::array kEnumNames<FeatureType> = {"SIFT", "ALIKED_N16ROT", "ALIKED_N32", "LOMA_B", "LOMA_B128"};

// How photos are matched, by COLMAP 4's names of features and method. AUTO: the database's features by brute force, and
// photos that this does not localize once more with ALIKED features by LightGlue.
enum class MatcherType { AUTO, SIFT_BRUTEFORCE, ALIKED_BRUTEFORCE, ALIKED_LIGHTGLUE };
template <>
inline constexpr std::array kEnumNames<MatcherType> = {"AUTO", "SIFT_BRUTEFORCE", "ALIKED_BRUTEFORCE",
                                                       "ALIKED_LIGHTGLUE"};

inline bool IsAliked(FeatureType type) { return type == FeatureType::ALIKED_N16ROT || type == FeatureType::ALIKED_N32; }

struct Features {
  std::vector<Keypoint> keypoints;
  Descriptors descriptors;
  FeatureType type = FeatureType::SIFT;
};

// Returns a keypoint after its image was scaled.
inline Keypoint Scaled(const Keypoint& keypoint, float scale_x, float scale_y) {
  const auto [x, y, a11, a12, a21, a22] = keypoint;
  return {x * scale_x, y * scale_y, a11 * scale_x, a12 * scale_y, a21 * scale_x, a22 * scale_y};
}

// Returns the positions of keypoints, in pixels.
inline std::vector<Eigen::Vector2d> Positions(const std::vector<Keypoint>& keypoints) {
  std::vector<Eigen::Vector2d> positions;
  positions.reserve(keypoints.size());
  for (const Keypoint& keypoint : keypoints) positions.emplace_back(keypoint.x, keypoint.y);
  return positions;
}

}  // namespace lazyloc
