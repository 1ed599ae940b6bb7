#include <algorithm>
#include <random>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/sift.h"

namespace lazyloc {
namespace {

// Returns an image of random rectangles, which has features of all sizes.
colmap::Bitmap Rectangles(int width, int height) {
  colmap::Bitmap bitmap = AllocateBitmap(width, height, /*as_rgb=*/false);
  std::mt19937 random(1);
  for (int i = 0; i < 400; ++i) {
    const int x = static_cast<int>(random() % width), y = static_cast<int>(random() % height);
    const int size = 1 << (1 + random() % 6);
    const colmap::BitmapColor<uint8_t> color(static_cast<uint8_t>(random()));
    for (int v = y; v < std::min(y + size, height); ++v) {
      for (int u = x; u < std::min(x + size, width); ++u) bitmap.SetPixel(u, v, color);
    }
  }
  return bitmap;
}

bool AreEqual(const colmap::FeatureKeypoint& a, const colmap::FeatureKeypoint& b) {
  return a.x == b.x && a.y == b.y && a.a11 == b.a11 && a.a12 == b.a12 && a.a21 == b.a21 && a.a22 == b.a22;
}

void ExpectColmapsFeatures(const colmap::Bitmap& bitmap, const SiftExtractionOptions& options, int num_idle_threads) {
  colmap::FeatureKeypoints expected_keypoints, keypoints;
  Descriptors expected_descriptors, descriptors;
  ASSERT_TRUE(ExtractSift(bitmap, options, &expected_keypoints, &expected_descriptors));
  IdleThreads idle_threads(num_idle_threads);
  ExtractPlainSift(GreyValues(bitmap), bitmap.Width(), bitmap.Height(), options, &idle_threads, &keypoints,
                   &descriptors);
  ASSERT_GT(keypoints.size(), 50u);
  ASSERT_EQ(keypoints.size(), expected_keypoints.size());
  ASSERT_EQ(static_cast<size_t>(descriptors.rows()), keypoints.size());
  for (size_t i = 0; i < keypoints.size(); ++i) {
    ASSERT_TRUE(AreEqual(keypoints[i], expected_keypoints[i])) << i;
    const auto row = descriptors.row(static_cast<Eigen::Index>(i));
    const bool is_at_lower_border = keypoints[i].y > static_cast<float>(bitmap.Height()) - 4 && row.isZero();
    ASSERT_TRUE(is_at_lower_border || row == expected_descriptors.row(static_cast<Eigen::Index>(i))) << i;
  }
}

TEST(ExtractPlainSift, GivesColmapsFeatures) {
  for (const auto& [width, height] : {std::pair{320, 240}, {211, 333}}) {
    const colmap::Bitmap bitmap = Rectangles(width, height);
    SiftExtractionOptions options;
    ExpectColmapsFeatures(bitmap, options, 0);
    ExpectColmapsFeatures(bitmap, options, 3);
    options.first_octave = 0;
    ExpectColmapsFeatures(bitmap, options, 0);
    options.upright = true;
    ExpectColmapsFeatures(bitmap, options, 0);
    options.first_octave = 1;
    ExpectColmapsFeatures(bitmap, options, 0);
  }
}

TEST(ExtractPlainSift, KeepsTheLevelsThatColmapKeeps) {
  const colmap::Bitmap bitmap = Rectangles(320, 240);
  SiftExtractionOptions options;
  for (const int max_num_features : {100, 200, 300, 500}) {
    options.max_num_features = max_num_features;
    ExpectColmapsFeatures(bitmap, options, 0);
  }
}

TEST(ExtractPlainSift, ImagesWithoutTextureHaveNoFeatures) {
  IdleThreads idle_threads(0);
  for (const int size : {1, 2, 7, 40}) {
    colmap::FeatureKeypoints keypoints;
    Descriptors descriptors;
    ExtractPlainSift(std::vector<uint8_t>(static_cast<size_t>(size * size), 100), size, size, {}, &idle_threads,
                     &keypoints, &descriptors);
    EXPECT_TRUE(keypoints.empty());
    EXPECT_EQ(descriptors.rows(), 0);
  }
}

}  // namespace
}  // namespace lazyloc
