#include "colmap_lazyloc/features/visual_words.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"

namespace lazyloc {
namespace {

// Returns the share of descriptors whose nearest word is found.
double Recall(const VisualWords& words, const Descriptors& descriptors) {
  IdleThreads idle_threads(1);
  const Eigen::VectorXi nearest = NearestCentres(words.Words()).Find(descriptors, 1, &idle_threads).indices;
  const std::vector<int> found = words.Find(descriptors, &idle_threads);
  int num_right = 0;
  for (size_t i = 0; i < found.size(); ++i) num_right += found[i] == nearest[static_cast<Eigen::Index>(i)];
  return static_cast<double>(num_right) / static_cast<double>(found.size());
}

TEST(VisualWords, AreAsManyAsWanted) {
  IdleThreads idle_threads(1);
  for (const int num_words : {2, 64, 1000}) {
    const int found = VisualWords::Train(RandomDescriptors(4000, 1), num_words, 0, &idle_threads).NumWords();
    EXPECT_LE(found, num_words);
    EXPECT_GE(found, 0.95 * num_words);
  }
}

TEST(VisualWords, OfFewCellsAreSearchedExactly) {
  IdleThreads idle_threads(1);
  const VisualWords words = VisualWords::Train(RandomDescriptors(2000, 1), 200, 0, &idle_threads);
  EXPECT_EQ(Recall(words, RandomDescriptors(300, 2)), 1);
}

// Descriptors in a cluster of their own, as those of one scene point are, not evenly in all directions.
TEST(VisualWords, OfManyCellsAreMostlyFound) {
  IdleThreads idle_threads(1);
  const Descriptors points = RandomDescriptors(1000, 1);
  Descriptors descriptors(4000, 128);
  for (int i = 0; i < 4; ++i) descriptors.middleRows(1000 * i, 1000) = WithNoise(points, 2 + i);
  const VisualWords words = VisualWords::Train(descriptors, 1000, 0, &idle_threads);
  EXPECT_GT(Recall(words, WithNoise(points, 9)), 0.9);
}

TEST(VisualWords, EachCellHasOne) {
  IdleThreads idle_threads(1);
  const Descriptors same = RandomDescriptors(1, 1).replicate(1000, 1);
  const VisualWords words = VisualWords::Train(same, 640, 0, &idle_threads);  // nine of ten cells have no descriptors
  EXPECT_EQ(words.NumWords(), 640 + 9);
  for (const int word : words.Find(RandomDescriptors(100, 2), &idle_threads)) EXPECT_GE(word, 0);
}

}  // namespace
}  // namespace lazyloc
