#include "colmap_lazyloc/bridge/sift_pyramid.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/smoothing.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr double kImageScale = 0.5;  // that is assumed of an image

// The ratio of the scales of two levels, and the scale of the first keypoint's level.
const double kLevelRatio = std::pow(2.0, 1.0 / kNumKeypointLevels);
const double kFirstScale = 1.6 * kLevelRatio;

// Sets the result, of `width` columns and `height` rows, to every step-th pixel of an image.
void Subsample(const float* image, int image_width, int step, int width, int height, float* result) {
  for (int y = 0; y < height; ++y) {
    const float* row = image + static_cast<size_t>(y) * step * image_width;
    for (int x = 0; x < width; ++x) *result++ = row[static_cast<size_t>(x) * step];
  }
}

// Doubles the size of an image by linear interpolation.
void Upsample(const float* image, int width, int height, float* result) {
  const size_t stride = 2 * static_cast<size_t>(width);
  for (int y = 0; y < height; ++y) {
    const float* row = image + static_cast<size_t>(y) * width;
    float* wide_row = result + 2 * static_cast<size_t>(y) * stride;
    for (int x = 0; x < width - 1; ++x) {
      wide_row[2 * x] = row[x];
      wide_row[2 * x + 1] = 0.5f * (row[x] + row[x + 1]);
    }
    wide_row[stride - 2] = wide_row[stride - 1] = row[width - 1];
  }
  for (int y = 0; y < height; ++y) {
    const float* row = result + 2 * static_cast<size_t>(y) * stride;
    const float* next = y + 1 < height ? row + 2 * stride : row;
    float* between = result + (2 * static_cast<size_t>(y) + 1) * stride;
    for (size_t x = 0; x < stride; ++x) between[x] = 0.5f * (row[x] + next[x]);
  }
}

SiftOctave AllocateOctave(int width, int height, int index) {
  SiftOctave octave;
  octave.index = index;
  octave.width = index < 0 ? width << -index : width >> index;
  octave.height = index < 0 ? height << -index : height >> index;
  const size_t size = static_cast<size_t>(octave.width) * octave.height;
  for (LargeArray& level : octave.levels) {
    level = AllocateLargeArray(size + kLevelPadding);
    std::fill_n(level.get() + size, kLevelPadding, 0.0f);
  }
  return octave;
}

void SmoothLevel(const SiftOctave& octave, const float* image, double stddev_px, IdleThreads* idle_threads,
                 float* level) {
  Smooth(image, octave.width, octave.height, GaussianWeights(stddev_px), idle_threads, level);
}

// Sets the first level of the finest octave.
void FillFirstLevel(const std::vector<uint8_t>& grey, int width, int height, IdleThreads* idle_threads,
                    SiftOctave* octave) {
  std::vector<float> image;
  image.reserve(grey.size());
  for (const uint8_t value : grey) image.push_back(static_cast<float>(value) / 255.0f);
  float* sampled = octave->levels[1].get();  // not yet used
  if (octave->index < 0) {
    Upsample(image.data(), width, height, sampled);
  } else {
    Subsample(image.data(), width, 1 << octave->index, octave->width, octave->height, sampled);
  }
  const double wanted = kFirstScale * std::pow(kLevelRatio, -kFirstKeypointLevel);
  const double given = kImageScale * std::pow(2.0, -octave->index);
  SmoothLevel(*octave, sampled, std::sqrt(wanted * wanted - given * given), idle_threads, octave->levels[0].get());
}

}  // namespace

double ScaleOfLevel(double levels_from_first) {
  return kFirstScale * std::pow(2.0, levels_from_first / kNumKeypointLevels);
}

double LevelSmoothing(int level) {
  const double first = kFirstScale * std::sqrt(1.0 - 1.0 / (kLevelRatio * kLevelRatio));
  return first * std::pow(kLevelRatio, level - kFirstKeypointLevel);
}

std::vector<SiftOctave> MakeOctaves(const std::vector<uint8_t>& grey, int width, int height, int first_octave,
                                    int num_octaves, IdleThreads* idle_threads) {
  LAZYLOC_CHECK(first_octave >= -1 && grey.size() == static_cast<size_t>(width) * height);
  std::vector<SiftOctave> octaves;
  for (int i = 0; i < num_octaves; ++i) {
    octaves.push_back(AllocateOctave(width, height, first_octave + i));
    SiftOctave& octave = octaves.back();
    if (i == 0) {
      FillFirstLevel(grey, width, height, idle_threads, &octave);
    } else {
      // This level has the smoothing of the next octave's first one.
      const SiftLevel finer = octaves[static_cast<size_t>(i - 1)].Level(kNumKeypointLevels);
      Subsample(finer.values, finer.width, 2, octave.width, octave.height, octave.levels[0].get());
    }
    for (size_t level = 1; level < kNumStoredLevels; ++level) {
      SmoothLevel(octave, octave.levels[level - 1].get(), LevelSmoothing(static_cast<int>(level)), idle_threads,
                  octave.levels[level].get());
    }
  }
  return octaves;
}

}  // namespace lazyloc
