#include "colmap_lazyloc/features/mutual_neighbours.h"

#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

// Returns features whose descriptors are unit vectors in the plane of the first two axes.
Features AtAngles(const std::vector<float>& angles_rad) {
  Features features;
  features.type = FeatureType::ALIKED_N16ROT;
  features.keypoints.resize(angles_rad.size());
  features.descriptors.setZero(static_cast<Eigen::Index>(angles_rad.size()), kDescriptorLength * sizeof(float));
  for (size_t i = 0; i < angles_rad.size(); ++i) {
    const float values[] = {std::cos(angles_rad[i]), std::sin(angles_rad[i])};
    std::memcpy(features.descriptors.row(static_cast<Eigen::Index>(i)).data(), values, sizeof(values));
  }
  return features;
}

TEST(CountMutualNeighbours, CountsEachFeatureOnce) {
  EXPECT_EQ(CountMutualNeighbours(AtAngles({0, 1, 2}), AtAngles({2.1f, 0.1f, 1.1f})), 3);
  // Two features have the same nearest neighbour, which has only one of its own.
  EXPECT_EQ(CountMutualNeighbours(AtAngles({0, 0.1f}), AtAngles({0.08f})), 1);
  EXPECT_EQ(CountMutualNeighbours(AtAngles({0.08f}), AtAngles({0, 0.1f})), 1);
}

TEST(CountMutualNeighbours, LeavesOutThoseThatAreTooDifferent) {
  EXPECT_EQ(CountMutualNeighbours(AtAngles({0}), AtAngles({0.7f})), 1);
  EXPECT_EQ(CountMutualNeighbours(AtAngles({0}), AtAngles({0.9f})), 0);
}

TEST(CountMutualNeighbours, IsZeroWithoutFeatures) {
  EXPECT_EQ(CountMutualNeighbours(AtAngles({}), AtAngles({1})), 0);
  EXPECT_EQ(CountMutualNeighbours(AtAngles({1}), AtAngles({})), 0);
}

}  // namespace
}  // namespace lazyloc
