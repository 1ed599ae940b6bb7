#include "colmap_lazyloc/two_view/relative_pose.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

struct Errors {
  double rotation_deg, direction_deg;
};

class RelativePoses : public testing::Test {
 protected:
  RelativePoses() {
    options_.pixel_noise_px = 0.2;
    options_.outlier_match_ratio = 0.2;
    Make();
  }
  void Make() { scene_ = MakeSyntheticScene(options_); }
  ImagePair& Pair() { return scene_.problem.pairs[3]; }
  Rigid3d Truth() { return scene_.query_cam_from_world * Inverse(Pair().database_cam_from_world); }
  std::optional<RelativePose> Find(uint32_t seed = 1) { return FindRelativePose(scene_.problem, Pair(), seed); }
  Errors ErrorsOf(const RelativePose& pose) {
    return {RotationErrorDeg(pose.query_from_other, Truth()),
            RadToDeg(AngleBetweenRad(pose.query_from_other.translation, Truth().translation))};
  }

  SyntheticSceneOptions options_;
  SyntheticScene scene_;
};

TEST_F(RelativePoses, StoredPoseIsTakenAsItIs) {
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_EQ(pose->query_from_other.rotation.coeffs(), Pair().geometry->query_from_other->rotation.coeffs());
  EXPECT_EQ(pose->query_from_other.translation, Pair().geometry->query_from_other->translation);
  EXPECT_EQ(pose->inlier_matches, Pair().geometry->inlier_matches);
}

TEST_F(RelativePoses, StoredEssentialMatrixIsDecomposed) {
  options_.pixel_noise_px = options_.outlier_match_ratio = 0;
  Make();
  const Rigid3d truth = Truth();
  Pair().geometry->query_from_other.reset();
  Pair().geometry->E = Hat(truth.translation) * truth.rotation.toRotationMatrix();
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(ErrorsOf(*pose).rotation_deg, 1e-6);
  EXPECT_LE(ErrorsOf(*pose).direction_deg, 1e-6);
}

TEST_F(RelativePoses, NeitherPoseNorMatrixIsNoPose) {
  Pair().geometry->query_from_other.reset();
  EXPECT_FALSE(Find().has_value());
}

// Allows several standard deviations, which are below a tenth of a degree for 200 matches of 0.2 px and a wide
// baseline.
TEST_F(RelativePoses, RawMatchesAreVerified) {
  Pair().matches = Pair().geometry->inlier_matches;
  Pair().geometry.reset();
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(ErrorsOf(*pose).rotation_deg, 0.2);
  EXPECT_LE(ErrorsOf(*pose).direction_deg, 1);
  EXPECT_GE(pose->inlier_matches.size(), 155u);
  EXPECT_LE(pose->inlier_matches.size(), 175u) << "outliers were kept";
}

TEST_F(RelativePoses, UncalibratedPairIsEstimatedAgain) {
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  Pair().geometry->query_from_other = Rigid3d();
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(ErrorsOf(*pose).rotation_deg, 0.2);
}

TEST_F(RelativePoses, UncalibratedPairLosesWhatTheIntrinsicsContradict) {
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_GE(pose->inlier_matches.size(), 155u);
  EXPECT_LE(pose->inlier_matches.size(), 175u) << "outliers were kept";
}

TEST_F(RelativePoses, UncalibratedPairThatTheIntrinsicsDoNotExplainIsDropped) {
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  Matches& matches = Pair().geometry->inlier_matches;
  for (size_t i = 0; i + 1 < matches.size(); ++i) {
    if (i % 3 != 0) std::swap(matches[i].query_point, matches[i + 1].query_point);
  }
  EXPECT_FALSE(Find().has_value());
}

TEST_F(RelativePoses, StoredEssentialMatrixOfUncalibratedPairIsTaken) {
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  Pair().geometry->E = Hat(Truth().translation) * Truth().rotation.toRotationMatrix();
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(ErrorsOf(*pose).rotation_deg, 1e-6) << "estimated from noisy matches";
  EXPECT_GE(pose->inlier_matches.size(), 155u);
  EXPECT_LE(pose->inlier_matches.size(), 175u) << "outliers were kept";
}

// Bounds the error as that of a pair without a stored essential matrix.
TEST_F(RelativePoses, UncalibratedPairThatItsEssentialMatrixDoesNotExplainIsEstimated) {
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  Pair().geometry->E = Hat(Eigen::Vector3d::UnitX());
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(ErrorsOf(*pose).rotation_deg, 0.2);
}

TEST_F(RelativePoses, SameSeedSameResult) {
  Pair().matches = Pair().geometry->inlier_matches;
  Pair().geometry.reset();
  const std::optional<RelativePose> first = Find(7), second = Find(7);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->query_from_other.rotation.coeffs(), second->query_from_other.rotation.coeffs());
  EXPECT_EQ(first->inlier_matches, second->inlier_matches);
}

TEST_F(RelativePoses, PanoramicPairHasNoTranslation) {
  Pair().geometry->config = TwoViewConfig::PANORAMIC;
  const std::optional<RelativePose> pose = Find();
  ASSERT_TRUE(pose.has_value());
  EXPECT_TRUE(pose->query_from_other.translation.isZero());
}

TEST_F(RelativePoses, DegenerateWatermarkAndSmallPairsAreNotUsed) {
  for (const TwoViewConfig config : {TwoViewConfig::DEGENERATE, TwoViewConfig::WATERMARK}) {
    Pair().geometry->config = config;
    EXPECT_FALSE(Find().has_value());
  }
  Pair().geometry->config = TwoViewConfig::CALIBRATED;
  Pair().geometry->inlier_matches.resize(14);
  EXPECT_FALSE(Find().has_value());
}

TEST_F(RelativePoses, InlierMatchesNeedNoCalibration) {
  const auto find = [&] { return FindInlierMatches(scene_.problem, Pair(), /*seed=*/1); };
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  EXPECT_EQ(find(), Pair().geometry->inlier_matches);
  Pair().geometry->config = TwoViewConfig::WATERMARK;
  EXPECT_TRUE(find().empty());
  Pair().geometry->config = TwoViewConfig::UNCALIBRATED;
  Pair().geometry->inlier_matches.resize(14);
  EXPECT_TRUE(find().empty());
}

TEST_F(RelativePoses, RawMatchesAreVerifiedWithoutTheFocalLength) {
  options_.has_geometry = false;
  Make();
  scene_.problem.query_camera.params[0] *= 2.5;
  scene_.problem.query_camera.params[1] *= 2.5;
  const Matches inliers = FindInlierMatches(scene_.problem, Pair(), /*seed=*/1);
  const auto is_right = [](const Match& match) { return match.query_point == match.other_point; };
  const auto num_right = std::count_if(inliers.begin(), inliers.end(), is_right);
  EXPECT_GE(num_right, 155) << "of 160 right ones";
  EXPECT_LE(inliers.size() - num_right, 4) << "of 40 wrong ones, by chance on their epipolar line";
}

}  // namespace
}  // namespace lazyloc
