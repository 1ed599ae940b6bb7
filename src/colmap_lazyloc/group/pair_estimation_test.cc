#include "colmap_lazyloc/group/pair_estimation.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

SyntheticGroup MakeGroup(int num_frames, int num_database_images, bool has_query_pairs) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = 1;
  options.num_database_images = num_database_images;
  options.has_query_pairs = has_query_pairs;
  return MakeSyntheticGroup(options);
}

// Leaves each pair of a query the given number of inliers.
void SetNumInliers(const std::vector<size_t>& num_inliers, LocalizationProblem* problem) {
  ASSERT_EQ(problem->pairs.size(), num_inliers.size());
  for (size_t i = 0; i < num_inliers.size(); ++i) problem->pairs[i].geometry->inlier_matches.resize(num_inliers[i]);
}

PairEstimates Estimate(const QueryGroup& group, const LocalizerOptions& options = {}, bool uses_focal_length = true) {
  StageTimer::Seconds seconds;
  KnownRelativePoses known;
  return EstimatePairs(group, MakeLayout(group), uses_focal_length, options, &known, &seconds);
}

PairEstimates FindInliers(const QueryGroup& group) { return Estimate(group, {}, /*uses_focal_length=*/false); }

std::vector<int> OthersOf(const PairEstimates& estimates) {
  std::vector<int> others;
  for (const PairGeometry& pair : estimates.pairs) others.push_back(pair.other);
  return others;
}

TEST(EstimatePairs, KeepsThePairsWithMostInliersInTheirOrder) {
  SyntheticGroup scene = MakeGroup(1, 6, false);
  SetNumInliers({40, 100, 60, 100, 60, 5}, &scene.group.images[0].problem);
  const LocalizerOptions options;
  scene.group.images[0].problem.max_num_pairs = 3;
  const PairEstimates estimates = Estimate(scene.group, options);
  EXPECT_THAT(OthersOf(estimates), ElementsAre(2, 3, 4));  // image 0 is the query; the first of equal pairs is kept
  EXPECT_THAT(estimates.num_inliers, ElementsAre(ElementsAre(40, 100, 60, 100, 60, 0)));
  scene.group.images[0].problem.max_num_pairs = 0;
  EXPECT_THAT(OthersOf(Estimate(scene.group, options)), ElementsAre(1, 2, 3, 4, 5));
}

TEST(EstimatePairs, PairsBetweenQueriesComeLast) {
  const PairEstimates estimates = Estimate(MakeGroup(2, 2, true).group);
  EXPECT_THAT(OthersOf(estimates), ElementsAre(2, 3, 4, 5, 0));
  EXPECT_EQ(estimates.pairs.back().query, 1);
}

TEST(EstimatePairs, ObservationsFulfilTheEpipolarConstraint) {
  const SyntheticGroup scene = MakeGroup(2, 3, true);
  for (const PairGeometry& pair : Estimate(scene.group).pairs) {
    EXPECT_EQ(pair.num_inliers, 150);
    ASSERT_EQ(pair.inliers.size(), 150u);
    EXPECT_NEAR(pair.query_from_other.translation.norm(), 1, 1e-12);
    for (const ObservedMatch& inlier : pair.inliers) {
      const Eigen::Vector3d other_ray = pair.query_from_other.rotation * inlier.other.ray_in_cam;
      EXPECT_NEAR(inlier.query.ray_in_cam.dot(pair.query_from_other.translation.cross(other_ray)), 0, 1e-9);
    }
  }
}

TEST(EstimatePairs, RelativePoseOfRawMatchesIsEstimated) {
  SyntheticSceneOptions options;
  options.has_geometry = false;
  options.num_database_images = 2;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const PairEstimates estimates = Estimate(LoneQuery(scene));
  ASSERT_EQ(estimates.pairs.size(), 2u);
  for (int i = 0; i < 2; ++i) {
    const Rigid3d truth = scene.query_cam_from_world * Inverse(scene.problem.pairs[i].database_cam_from_world);
    EXPECT_LE(RotationErrorDeg(estimates.pairs[i].query_from_other, truth), 0.01);
    EXPECT_LE((estimates.pairs[i].query_from_other.translation - truth.translation.normalized()).norm(), 1e-3);
  }
}

TEST(EstimatePairs, InliersThatCannotBeUnprojectedAreCountedOnly) {
  SyntheticGroup scene = MakeGroup(1, 2, false);
  scene.group.images[0].problem.query_keypoints[7].x() = std::numeric_limits<double>::quiet_NaN();
  scene.group.images[0].problem.pairs[1].other_keypoints[8].y() = std::numeric_limits<double>::quiet_NaN();
  const PairEstimates estimates = Estimate(scene.group);
  EXPECT_EQ(estimates.pairs[0].num_inliers, 150);
  EXPECT_EQ(estimates.pairs[0].inliers.size(), 149u);
  EXPECT_EQ(estimates.pairs[1].inliers.size(), 148u);
}

TEST(EstimatePairs, FramesWithoutAnyPairAreNamed) {
  SyntheticGroup scene = MakeGroup(3, 4, false);
  SetNumInliers({14, 14, 0, 14}, &scene.group.images[1].problem);
  const Failure failure = FailureOf([&] { Estimate(scene.group); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_INLIERS);
  EXPECT_THAT(failure.frames, ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("none of 4 pairs has 15 verified inliers"));
}

TEST(EstimatePairs, PairsWithOtherQueriesSuffice) {
  for (const int query : {0, 1}) {
    SyntheticGroup scene = MakeGroup(2, 4, true);
    SetNumInliers({14, 14, 0, 14}, &scene.group.images[query].problem);
    const PairEstimates estimates = Estimate(scene.group);
    EXPECT_THAT(estimates.num_inliers[query], ElementsAre(0, 0, 0, 0));
    EXPECT_EQ(estimates.pairs.size(), 4u + 1);
  }
}

// Expects the vector from the principal point, because the focal length scales image points about it.
TEST(FindInliers, QueriesHaveTheDerivativeByTheFocalLength) {
  const SyntheticGroup scene = MakeGroup(1, 2, false);
  const LocalizationProblem& problem = scene.group.images[0].problem;
  const PairEstimates estimates = FindInliers(scene.group);
  ASSERT_EQ(estimates.pairs.size(), 2u);
  EXPECT_THAT(estimates.num_inliers, ElementsAre(ElementsAre(150, 150)));
  for (const PairGeometry& pair : estimates.pairs) {
    for (const ObservedMatch& inlier : pair.inliers) {
      const Eigen::Vector2d from_centre = problem.query_keypoints[inlier.match.query_point] - Eigen::Vector2d(640, 480);
      EXPECT_LE((inlier.query.px_from_log_focal - from_centre).norm(), 1e-3 * from_centre.norm());
    }
  }
}

TEST(FindInliers, RelativePosesAreNotUsed) {
  SyntheticGroup scene = MakeGroup(1, 2, false);
  scene.group.images[0].problem.pairs[0].geometry->query_from_other.reset();
  const PairEstimates estimates = FindInliers(scene.group);
  ASSERT_EQ(estimates.pairs.size(), 2u);
  for (const PairGeometry& pair : estimates.pairs) ExpectSameBits(pair.query_from_other, Rigid3d());
}

}  // namespace
}  // namespace lazyloc
