#include "colmap_lazyloc/features/pair_matching.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/features/sift_method.h"
#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr int kNumPoints = 2500;  // more than are compared first

// A photo and database images side by side that see the same points: features with descriptors, scales of 1 to 10
// pixels, and noise of 0.3 pixels.
class PairMatchingTest : public ::testing::Test {
 protected:
  PairMatchingTest() {
    Random random(1);
    camera_ = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), 800, 1000, 750);
    std::uniform_real_distribution<double> across(-2, 2), along(4, 7);
    for (int i = 0; i < kNumPoints; ++i) points_.emplace_back(across(random), across(random), along(random));
    descriptors_ = RandomDescriptors(kNumPoints, 1);
    problem_.query_name = "photo";
    problem_.query_camera = camera_;
    query_ = MakeFeatures(Eigen::Vector3d::Zero(), 2);
    problem_.query_keypoints = Positions(query_.keypoints);
  }

  Features MakeFeatures(const Eigen::Vector3d& cam_in_world, uint32_t seed) const {
    Random random(seed);
    Features features;
    features.descriptors = WithNoise(descriptors_, seed);
    for (int i = 0; i < kNumPoints; ++i) {
      const Eigen::Vector3d noise = 0.3 * RandomVector(&random);
      const Eigen::Vector2d xy = *ImageFromCam(camera_, points_[i] - cam_in_world) + noise.head<2>();
      const float scale = std::pow(10.0f, static_cast<float>(i) / kNumPoints);
      features.keypoints.push_back({static_cast<float>(xy.x()), static_cast<float>(xy.y()), scale, 0, 0, scale});
    }
    return features;
  }

  void AddImage(Features features) {
    ImagePair pair;
    pair.other_name = "image" + std::to_string(problem_.pairs.size());
    pair.other_camera = camera_;
    problem_.pairs.push_back(std::move(pair));
    database_.push_back(std::make_shared<const Features>(std::move(features)));
  }

  void Match(const PairMatchingOptions& options) {
    StageTimer::Seconds seconds;
    IdleThreads idle_threads(0);
    MatchPairs(method_, query_, database_, options, &idle_threads, &problem_, &seconds);
  }

  static size_t NumInliers(const ImagePair& pair) {
    for (const lazyloc::Match& match : pair.geometry->inlier_matches) EXPECT_EQ(match.query_point, match.other_point);
    return pair.geometry->inlier_matches.size();
  }

  const Sift method_{{}, {}, {}};
  Camera camera_;
  std::vector<Eigen::Vector3d> points_;
  Descriptors descriptors_;
  LocalizationProblem problem_;
  Features query_;
  std::vector<std::shared_ptr<const Features>> database_;
};

TEST_F(PairMatchingTest, FindsTheMatchesOfAllFeaturesAlongEpipolarLines) {
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::GIVEN, IntrinsicsOrigin::GUESS}) {
    problem_.intrinsics_origin = origin;
    problem_.pairs.clear();
    database_.clear();
    AddImage(MakeFeatures({0.5, 0, 0}, 3));
    AddImage(MakeFeatures({-0.3, 0.4, 0.1}, 4));
    Match({});
    EXPECT_TRUE(HasFurtherFeatures(method_, problem_)) << "features were left out at first";
    for (const ImagePair& pair : problem_.pairs) EXPECT_GT(NumInliers(pair), 0.99 * kNumPoints);
    Match({0, /*compares_all=*/true});
    for (const ImagePair& pair : problem_.pairs) EXPECT_GT(NumInliers(pair), 0.99 * kNumPoints);
  }
}

TEST_F(PairMatchingTest, ComparesFewFeaturesOnlyOnce) {
  query_.keypoints.resize(1000);
  query_.descriptors.conservativeResize(1000, Eigen::NoChange);
  problem_.query_keypoints.resize(1000);
  AddImage(query_);
  Match({});
  EXPECT_FALSE(HasFurtherFeatures(method_, problem_));
  AddImage(MakeFeatures({0.5, 0, 0}, 3));
  Match({});
  EXPECT_TRUE(HasFurtherFeatures(method_, problem_)) << "the new image has more";
}

// Of a photo that is taken from far nearer, for example, the largest features are small in the database image.
TEST_F(PairMatchingTest, NeedsAllFeaturesIfTheLargestOnesDiffer) {
  Features image = MakeFeatures({0.5, 0, 0}, 3);
  for (Keypoint& keypoint : image.keypoints) keypoint.a11 = keypoint.a22 = 10 / keypoint.a11;
  constexpr int kNumInBoth = 500;  // that are among the largest of both images
  image.descriptors.middleRows((kNumPoints - kNumInBoth) / 2, kNumInBoth) = RandomDescriptors(kNumInBoth, 9);
  AddImage(std::move(image));
  Match({});
  EXPECT_TRUE(HasFurtherFeatures(method_, problem_));
  EXPECT_EQ(problem_.pairs[0].geometry->config, TwoViewConfig::DEGENERATE);
  Match({0, /*compares_all=*/true});
  EXPECT_GT(NumInliers(problem_.pairs[0]), 0.99 * (kNumPoints - kNumInBoth));
}

TEST_F(PairMatchingTest, VerifiesTheImagesWithTheMostMatches) {
  for (const uint32_t seed : {3, 4, 5}) {
    Features image = MakeFeatures({0.1 * seed, 0, 0}, seed);
    const int num_others = 500 * static_cast<int>(seed - 3);
    image.descriptors.bottomRows(num_others) = RandomDescriptors(num_others, seed);  // of large features
    AddImage(std::move(image));
  }
  PairMatchingOptions options;
  options.max_num_verified = 2;
  Match(options);
  EXPECT_TRUE(HasFurtherFeatures(method_, problem_));
  EXPECT_GT(NumInliers(problem_.pairs[0]), 2400u);
  EXPECT_GT(NumInliers(problem_.pairs[1]), 1900u);
  EXPECT_EQ(problem_.pairs[2].geometry->config, TwoViewConfig::DEGENERATE);
}

}  // namespace
}  // namespace lazyloc
