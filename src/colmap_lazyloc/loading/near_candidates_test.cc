#include "colmap_lazyloc/loading/near_candidates.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

// Database images on a line, a length unit apart.
class NearCandidatesTest : public ::testing::Test {
 protected:
  void AddImages(size_t num_images) {
    images_.resize(num_images);
    for (size_t i = 0; i < num_images; ++i) {
      images_[i].cam_from_world.translation.x() = -static_cast<double>(i);
      candidates_.push_back({&images_[i], static_cast<uint32_t>(i)});
    }
  }
  DatabaseCandidates Near(const Eigen::Vector3d& position, const Eigen::Vector3d& stddevs) const {
    PositionPrior prior;
    prior.position = position;
    prior.covariance = stddevs.cwiseAbs2().asDiagonal();
    return FindNearCandidates(prior, candidates_);
  }
  size_t Place(const DatabaseCandidate* candidate) const { return candidate - candidates_.data(); }

  std::vector<ModelImage> images_;
  std::vector<DatabaseCandidate> candidates_;
};

TEST_F(NearCandidatesTest, AreTheNearestOfAllPlacesThatThePositionAllows) {
  AddImages(400);
  const DatabaseCandidates near = Near({100, 0, 0}, {0.01, 0.01, 0.01});
  ASSERT_THAT(near, SizeIs(51));  // two are equally far away
  EXPECT_EQ(Place(near.front()), 75);
  EXPECT_EQ(Place(near.back()), 125);
  const DatabaseCandidates uncertain = Near({100, 0, 0}, {2, 2, 2});
  ASSERT_THAT(uncertain, SizeIs(75));
  EXPECT_EQ(Place(uncertain.front()), 63);
  for (const double error : {-6.0, 6.0}) {
    for (const DatabaseCandidate* candidate : Near({100 + error, 0, 0}, {0.01, 0.01, 0.01})) {
      EXPECT_THAT(uncertain, ::testing::Contains(candidate));
    }
  }
}

TEST_F(NearCandidatesTest, AnUncertainHeightDoesNotCount) {
  AddImages(400);
  EXPECT_EQ(Near({100, 0, 40}, {2, 2, 200}), Near({100, 0, 0}, {2, 2, 200}));
}

TEST_F(NearCandidatesTest, NoneIfThePositionTellsTooLittle) {
  AddImages(400);
  EXPECT_THAT(Near({100, 0, 0}, {30, 30, 30}), IsEmpty());
  candidates_.resize(90);
  EXPECT_THAT(Near({40, 0, 0}, {0.01, 0.01, 0.01}), IsEmpty());
  candidates_.resize(50);
  EXPECT_THAT(Near({40, 0, 0}, {0.01, 0.01, 0.01}), IsEmpty());
}

}  // namespace
}  // namespace lazyloc
