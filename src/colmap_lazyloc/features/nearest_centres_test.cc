#include "colmap_lazyloc/features/nearest_centres.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"

namespace lazyloc {
namespace {

std::vector<int> NearestByDefinition(const Descriptors& centres, const Eigen::RowVectorXi& descriptor,
                                     int num_neighbours) {
  const Eigen::VectorXi distances = (centres.cast<int>().rowwise() - descriptor).rowwise().squaredNorm();
  std::vector<int> indices(centres.rows());
  std::iota(indices.begin(), indices.end(), 0);
  std::stable_sort(indices.begin(), indices.end(), [&](int a, int b) { return distances[a] < distances[b]; });
  indices.resize(num_neighbours, -1);
  return indices;
}

TEST(NearestCentres, FindsTheNearestOnes) {
  IdleThreads idle_threads(2);
  for (const int num_centres : {3, 64, 600}) {
    Descriptors centres = RandomDescriptors(num_centres, 1);
    centres.row(num_centres - 1) = centres.row(0);  // among equal centres the first comes first
    const Descriptors descriptors = WithNoise(centres, 2);
    const Neighbours found = NearestCentres(centres).Find(descriptors, 5, &idle_threads);
    ASSERT_EQ(found.indices.rows(), descriptors.rows());
    ASSERT_EQ(found.indices.cols(), 5);
    for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
      const Eigen::RowVectorXi descriptor = descriptors.row(i).cast<int>();
      const Eigen::RowVectorXi indices = found.indices.row(i);
      EXPECT_EQ(std::vector<int>(indices.begin(), indices.end()), NearestByDefinition(centres, descriptor, 5));
      const Eigen::RowVectorXi difference = centres.row(indices[0]).cast<int>() - descriptor;
      EXPECT_EQ(found.distances(i, 0), difference.squaredNorm() - descriptor.squaredNorm());
    }
  }
}

TEST(NearestCentres, NoDescriptorsHaveNone) {
  IdleThreads idle_threads(0);
  EXPECT_EQ(NearestCentres(RandomDescriptors(10, 1)).Find(Descriptors(0, 128), 5, &idle_threads).indices.rows(), 0);
}

TEST(FindCentres, OneCentreIsTheMean) {
  IdleThreads idle_threads(0);
  const Descriptors descriptors = RandomDescriptors(99, 1);
  const Eigen::RowVectorXd mean = descriptors.cast<double>().colwise().mean();
  EXPECT_EQ(FindCentres(descriptors, 1, 0, &idle_threads), Descriptors(mean.array().round().cast<uint8_t>()));
}

TEST(FindCentres, FewDescriptorsAreCentresThemselves) {
  IdleThreads idle_threads(0);
  const Descriptors descriptors = RandomDescriptors(5, 1);
  EXPECT_EQ(FindCentres(descriptors, 7, 0, &idle_threads), descriptors);
}

TEST(FindCentres, ThreadsDoNotChangeThem) {
  const Descriptors descriptors = RandomDescriptors(500, 1);
  IdleThreads none(0), some(3);
  const Descriptors centres = FindCentres(descriptors, 40, 7, &none);
  EXPECT_EQ(centres.rows(), 40);
  EXPECT_EQ(centres, FindCentres(descriptors, 40, 7, &some));
}

}  // namespace
}  // namespace lazyloc
