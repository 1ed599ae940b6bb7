#include "colmap_lazyloc/features/feature_statistics.h"

#include <numeric>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr int kGivenNumFeatures = 500;
constexpr int kLikeDatabase = SiftExtractionOptions::kLikeDatabase;

SiftExtractionOptions Given(int max_num_features, int first_octave) {
  SiftExtractionOptions options;
  options.max_num_features = max_num_features;
  options.first_octave = first_octave;
  return options;
}

TEST(KeypointScale, IsThatOfTheShape) {
  EXPECT_FLOAT_EQ(KeypointScale({1, 2, /*a11=*/3, /*a12=*/-4, /*a21=*/4, /*a22=*/3}), 5);
  EXPECT_FLOAT_EQ(KeypointScale({1, 2, 2, 0, 0, 4}), 3);
}

TEST(MeasureFeatures, TakesQuantilesWithoutOutliers) {
  std::vector<size_t> num_features(100, 2000);
  num_features[7] = 9000;
  std::vector<double> scales(100);
  std::iota(scales.begin(), scales.end(), 1);
  const FeatureStatistics statistics = MeasureFeatures(num_features, scales);
  EXPECT_EQ(statistics.max_num_features, 2000u);
  EXPECT_EQ(statistics.min_scale_ratio, 5);
}

TEST(ChooseExtraction, FollowsTheScalesOfTheDatabase) {
  const SiftExtractionOptions automatic = Given(kLikeDatabase, SiftExtractionOptions::kOctaveLikeDatabase);
  const auto octave = [&](double min_scale_ratio, double focal_length_px, double size_px = 1000) {
    return ChooseExtraction(automatic, {2000, min_scale_ratio}, {size_px, focal_length_px}).first_octave;
  };
  EXPECT_EQ(octave(0.9 / 1000, 1000), -1);
  EXPECT_EQ(octave(1.8 / 1000, 1000), 0);
  EXPECT_EQ(octave(3.5 / 1000, 1000), 1);
  EXPECT_EQ(octave(1.8 / 1000, 500), -1) << "the photo shows the same things half as large";
  EXPECT_EQ(octave(1.8 / 1000, 2000), 1);
  EXPECT_EQ(octave(1.8 / 3200, 6400, 6400), 0) << "the photo is scaled down to 3200 pixels";
  EXPECT_EQ(octave(0, 1000), -1) << "unknown";
  EXPECT_EQ(octave(1, 1000), 2) << "nothing is as large";
}

TEST(ChooseExtraction, FollowsTheNumberOfTheDatabaseUpToColmapsMaximum) {
  const SiftExtractionOptions automatic = Given(kLikeDatabase, -1);
  EXPECT_EQ(ChooseExtraction(automatic, {3000, 0}, {1000, 1000}).max_num_features, 3000);
  EXPECT_EQ(ChooseExtraction(automatic, {20000, 0}, {1000, 1000}).max_num_features, 8192);
  EXPECT_EQ(ChooseExtraction(automatic, {0, 0}, {1000, 1000}).max_num_features, 8192);
}

TEST(ChooseExtraction, KeepsWhatTheUserGives) {
  const SiftExtractionOptions chosen = ChooseExtraction(Given(kGivenNumFeatures, -1), {3000, 0.01}, {1000, 1000});
  EXPECT_EQ(chosen.max_num_features, kGivenNumFeatures);
  EXPECT_EQ(chosen.first_octave, -1);
}

// Draws squares of many sizes, whose centres are keypoints.
PhotoFile Squares() {
  constexpr int kSize = 256;
  std::vector<uint8_t> pixels(kSize * kSize, 128);
  for (int cell = 0; cell < 64; ++cell) {
    const int half = 2 + cell % 7;
    for (int y = -half; y <= half; ++y) {
      for (int x = -half; x <= half; ++x) pixels[(16 + cell / 8 * 32 + y) * kSize + 16 + cell % 8 * 32 + x] = 255;
    }
  }
  return PhotoFile::FromPixels(pixels.data(), kSize, kSize, 1);
}

TEST(ExtractLikeDatabase, KeepsTheLargestScalesInTheirOrder) {
  const PhotoFile photo = Squares();
  IdleThreads idle_threads(0);
  const Features all = ExtractLikeDatabase(photo, 300, Given(8192, 0), {}, &idle_threads);
  ASSERT_GT(all.keypoints.size(), 60u);
  const size_t number = all.keypoints.size() / 2;
  const Features kept = ExtractLikeDatabase(photo, 300, Given(kLikeDatabase, 0), {number, 0}, &idle_threads);
  ASSERT_EQ(kept.keypoints.size(), number);
  ASSERT_EQ(kept.descriptors.rows(), static_cast<Eigen::Index>(number));
  float smallest_kept = 1e9f, largest_left = 0;
  size_t next = 0;
  for (size_t i = 0; i < all.keypoints.size(); ++i) {
    const bool is_kept = next < number && kept.keypoints[next].x == all.keypoints[i].x &&
                         kept.keypoints[next].y == all.keypoints[i].y &&
                         kept.keypoints[next].a11 == all.keypoints[i].a11;
    if (is_kept) {
      EXPECT_EQ(kept.descriptors.row(next), all.descriptors.row(i));
      smallest_kept = std::min(smallest_kept, KeypointScale(all.keypoints[i]));
      ++next;
    } else {
      largest_left = std::max(largest_left, KeypointScale(all.keypoints[i]));
    }
  }
  EXPECT_EQ(next, number);
  EXPECT_LE(largest_left, smallest_kept);
}

}  // namespace
}  // namespace lazyloc
