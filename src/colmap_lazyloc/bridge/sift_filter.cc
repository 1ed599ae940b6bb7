#include "colmap_lazyloc/bridge/sift_filter.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/math/smoothing.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

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
    for (int x = 0; x < width; ++x) {
      wide_row[2 * x] = row[x];
      wide_row[2 * x + 1] = 0.5f * (row[x] + row[std::min(x + 1, width - 1)]);
    }
  }
  for (int y = 0; y < height; ++y) {
    const float* row = result + 2 * static_cast<size_t>(y) * stride;
    const float* next = y + 1 < height ? row + 2 * stride : row;
    float* between = result + (2 * static_cast<size_t>(y) + 1) * stride;
    for (size_t x = 0; x < stride; ++x) between[x] = 0.5f * (row[x] + next[x]);
  }
}

int OctaveSize(int size, int octave) { return octave < 0 ? size << -octave : size >> octave; }

// Deletes all but the levels, which SiftFilter owns.
void Delete(VlSiftFilt* filter) {
  filter->octave = nullptr;
  vl_sift_delete(filter);
}

}  // namespace

SiftFilter::SiftFilter(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                       IdleThreads* idle_threads)
    : filter_(vl_sift_new(width, height, kColmapSift.num_octaves, kColmapSift.octave_resolution, options.first_octave),
              &Delete),
      idle_threads_(idle_threads) {
  LAZYLOC_CHECK(filter_ != nullptr && grey.size() == static_cast<size_t>(width) * height);
  vl_free(filter_->octave);  // has room for one octave only
  vl_sift_set_peak_thresh(filter_.get(), kColmapSift.peak_threshold);
  vl_sift_set_edge_thresh(filter_.get(), kColmapSift.edge_threshold);
  image_.reserve(grey.size());
  for (const uint8_t value : grey) image_.push_back(static_cast<float>(value) / 255.0f);
}

void SiftFilter::GoTo(int octave) {
  filter_->o_cur = octave;
  filter_->octave_width = OctaveSize(filter_->width, octave);
  filter_->octave_height = OctaveSize(filter_->height, octave);
  const auto index = static_cast<size_t>(octave - filter_->o_min);
  if (index == octaves_.size()) {
    const auto num_levels = static_cast<size_t>(filter_->s_max - filter_->s_min + 1);
    octaves_.emplace_back(new float[num_levels * filter_->octave_width * filter_->octave_height + kLevelPadding]);
  }
  filter_->octave = octaves_[index].get();
}

void SiftFilter::FillFirstLevel() {
  const int octave = filter_->o_min;
  GoTo(octave);
  if (octave < 0) {
    Upsample(image_.data(), filter_->width, filter_->height, filter_->temp);
  } else {
    Subsample(image_.data(), filter_->width, 1 << octave, filter_->octave_width, filter_->octave_height, filter_->temp);
  }
  const double wanted = filter_->sigma0 * std::pow(filter_->sigmak, filter_->s_min);
  const double given = filter_->sigman * std::pow(2.0, -octave);
  LAZYLOC_CHECK(wanted > given);
  SmoothTo(filter_->s_min, filter_->temp, std::sqrt(wanted * wanted - given * given));
}

void SiftFilter::SmoothTo(int level, const float* image, double stddev_px) {
  Smooth(image, filter_->octave_width, filter_->octave_height, GaussianWeights(stddev_px), idle_threads_,
         vl_sift_get_octave(filter_.get(), level));
}

std::vector<VlSiftKeypoint> SiftFilter::Detect() {
  std::vector<VlSiftKeypoint> keypoints;
  for (int octave = filter_->o_min; octave < filter_->o_min + filter_->O; ++octave) {
    if (octave == filter_->o_min) {
      FillFirstLevel();
    } else {
      // This level has the smoothing of the next octave's first one.
      const float* level = vl_sift_get_octave(filter_.get(), filter_->s_min + filter_->S);
      const int width = filter_->octave_width;
      GoTo(octave);
      Subsample(level, width, 2, filter_->octave_width, filter_->octave_height,
                vl_sift_get_octave(filter_.get(), filter_->s_min));
    }
    for (int level = filter_->s_min + 1; level <= filter_->s_max; ++level) {
      const double stddev_px = filter_->dsigma0 * std::pow(filter_->sigmak, level);
      SmoothTo(level, vl_sift_get_octave(filter_.get(), level - 1), stddev_px);
    }
    vl_sift_detect(filter_.get());
    const VlSiftKeypoint* detected = vl_sift_get_keypoints(filter_.get());
    keypoints.insert(keypoints.end(), detected, detected + vl_sift_get_nkeypoints(filter_.get()));
  }
  return keypoints;
}

SiftLevel SiftFilter::Level(const VlSiftKeypoint& keypoint) const {
  const int width = OctaveSize(filter_->width, keypoint.o), height = OctaveSize(filter_->height, keypoint.o);
  const float* octave = octaves_[static_cast<size_t>(keypoint.o - filter_->o_min)].get();
  return {octave + static_cast<size_t>(keypoint.is - filter_->s_min) * width * height, width, height};
}

}  // namespace lazyloc
