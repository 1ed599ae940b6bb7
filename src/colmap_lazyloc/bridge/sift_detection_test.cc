#include "colmap_lazyloc/bridge/sift_detection.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include <gtest/gtest.h>

// VLFeat's header, which COLMAP's sources and an installed COLMAP have in different places.
#if __has_include("thirdparty/VLFeat/sift.h")
#include "thirdparty/VLFeat/sift.h"
#else
#include <colmap/thirdparty/VLFeat/sift.h>
#endif

namespace lazyloc {
namespace {

constexpr int kNumOctaves = 4;
constexpr double kPeakThreshold = 0.02 / 3, kEdgeThreshold = 10;

struct Image {
  int width, height;
  std::vector<uint8_t> grey;
};

// Returns random pixels, on the left in blocks: extrema of all levels, which are at the border, too.
Image Noise(int width, int height) {
  Image image = {width, height, {}};
  std::mt19937 random(7);
  std::vector<uint8_t> blocks(static_cast<size_t>(width + height));
  for (uint8_t& value : blocks) value = static_cast<uint8_t>(random());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto block = static_cast<size_t>(x / 9 + y / 9 * 13) % blocks.size();
      image.grey.push_back(x < width / 2 ? blocks[block] : static_cast<uint8_t>(random()));
    }
  }
  return image;
}

void ExpectVlfeatsLevels(const SiftOctave& octave, const VlSiftFilt* vlfeat) {
  const size_t size = static_cast<size_t>(octave.width) * octave.height;
  for (int level = 0; level < kNumStoredLevels; ++level) {
    const float* expected = vl_sift_get_octave(vlfeat, level - kFirstKeypointLevel);
    EXPECT_TRUE(std::equal(expected, expected + size, octave.Level(level).values))
        << "octave " << octave.index << ", level " << level;
  }
}

// Returns how many keypoints there are.
size_t ExpectVlfeatsKeypoints(const SiftOctave& octave, int num_idle_threads, VlSiftFilt* vlfeat) {
  vl_sift_detect(vlfeat);
  IdleThreads idle_threads(num_idle_threads);
  const OctaveKeypoints keypoints = DetectKeypoints(octave, kPeakThreshold, kEdgeThreshold, &idle_threads);
  const VlSiftKeypoint* expected = vl_sift_get_keypoints(vlfeat);
  const VlSiftKeypoint* end = expected + vl_sift_get_nkeypoints(vlfeat);
  size_t count = 0;
  for (int level = 0; level < kNumKeypointLevels; ++level) {
    for (const SiftKeypoint& keypoint : keypoints[static_cast<size_t>(level)]) {
      EXPECT_TRUE(expected != end && expected->is == level && expected->x == std::ldexp(keypoint.x, octave.index) &&
                  expected->y == std::ldexp(keypoint.y, octave.index) &&
                  expected->sigma == std::ldexp(keypoint.scale, octave.index))
          << "keypoint " << count << " of octave " << octave.index;
      if (expected != end) ++expected;
      ++count;
    }
  }
  EXPECT_EQ(expected, end);
  return count;
}

size_t ExpectVlfeatsOctaves(const Image& image, int first_octave, int num_idle_threads) {
  const std::unique_ptr<VlSiftFilt, void (*)(VlSiftFilt*)> vlfeat(
      vl_sift_new(image.width, image.height, kNumOctaves, kNumKeypointLevels, first_octave), &vl_sift_delete);
  vl_sift_set_peak_thresh(vlfeat.get(), kPeakThreshold);
  vl_sift_set_edge_thresh(vlfeat.get(), kEdgeThreshold);
  std::vector<float> values;
  for (const uint8_t value : image.grey) values.push_back(static_cast<float>(value) / 255.0f);
  IdleThreads idle_threads(num_idle_threads);
  size_t num_keypoints = 0;
  for (const SiftOctave& octave :
       MakeOctaves(image.grey, image.width, image.height, first_octave, kNumOctaves, &idle_threads)) {
    EXPECT_EQ(octave.index == first_octave ? vl_sift_process_first_octave(vlfeat.get(), values.data())
                                           : vl_sift_process_next_octave(vlfeat.get()),
              VL_ERR_OK);
    ExpectVlfeatsLevels(octave, vlfeat.get());
    num_keypoints += ExpectVlfeatsKeypoints(octave, num_idle_threads, vlfeat.get());
  }
  return num_keypoints;
}

TEST(DetectKeypoints, GivesVlfeatsKeypointsOfNoise) {
  size_t num_keypoints = 0;
  for (const auto& [width, height] : {std::pair{97, 131}, {259, 301}, {66, 64}, {400, 33}}) {
    for (const int first_octave : {-1, 0, 1}) {
      const Image image = Noise(width, height);
      num_keypoints += ExpectVlfeatsOctaves(image, first_octave, 0);
      ExpectVlfeatsOctaves(image, first_octave, 3);
    }
  }
  EXPECT_GT(num_keypoints, 1000u);
}

TEST(DetectKeypoints, SmallImagesHaveVlfeatsKeypoints) {
  for (const auto& [width, height] : {std::pair{8, 8}, {9, 30}, {31, 10}, {17, 16}}) {
    ExpectVlfeatsOctaves(Noise(width, height), -1, 0);
  }
}

}  // namespace
}  // namespace lazyloc
