#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"

namespace lazyloc {
namespace {

std::vector<int> NearestByDefinition(const Descriptors& words, const Eigen::RowVectorXi& descriptor,
                                     int num_neighbors) {
  const Eigen::VectorXi distances = (words.cast<int>().rowwise() - descriptor).rowwise().squaredNorm();
  std::vector<int> indices(words.rows());
  std::iota(indices.begin(), indices.end(), 0);
  std::stable_sort(indices.begin(), indices.end(), [&](int a, int b) { return distances[a] < distances[b]; });
  indices.resize(num_neighbors);
  return indices;
}

TEST(VisualWords, FindsTheNearestOnes) {
  IdleThreads idle_threads(2);
  for (const int num_words : {3, 64, 600}) {
    Descriptors words = RandomDescriptors(num_words, 1);
    words.row(num_words - 1) = words.row(0);  // among equal words the first comes first
    const Descriptors descriptors = WithNoise(words, 2);
    const int num_neighbors = std::min(num_words, 5);
    const Eigen::MatrixXi found = VisualWords(words).Find(descriptors, 5, &idle_threads);
    ASSERT_EQ(found.rows(), descriptors.rows());
    ASSERT_EQ(found.cols(), num_neighbors);
    for (Eigen::Index i = 0; i < found.rows(); ++i) {
      const std::vector<int> expected = NearestByDefinition(words, descriptors.row(i).cast<int>(), num_neighbors);
      EXPECT_EQ(std::vector<int>(found.row(i).begin(), found.row(i).end()), expected);
    }
  }
}

TEST(VisualWords, NoDescriptorsHaveNoWords) {
  IdleThreads idle_threads(0);
  EXPECT_EQ(VisualWords(RandomDescriptors(10, 1)).Find(Descriptors(0, 128), 5, &idle_threads).rows(), 0);
}

TEST(ClusterWords, SameInputGivesTheSameWords) {
  const Descriptors descriptors = RandomDescriptors(500, 1);
  const Descriptors words = ClusterWords(descriptors, 40, 7);
  EXPECT_GE(words.rows(), 2);
  EXPECT_LE(words.rows(), 40);
  EXPECT_EQ(words, ClusterWords(descriptors, 40, 7));
}

}  // namespace
}  // namespace lazyloc
