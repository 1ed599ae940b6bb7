#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/bridge/sift_level.h"
#include "colmap_lazyloc/bridge/vlfeat.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// VLFeat's SIFT of one image. VLFeat detects the keypoints. Smoothing is our own, by the same steps, but several pixels
// at a time.
class SiftFilter {
 public:
  // grey: width * height values, row by row.
  SiftFilter(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
             IdleThreads* idle_threads);

  // Returns the keypoints of all octaves, level by level from the finest on. Called once, before what follows.
  std::vector<VlSiftKeypoint> Detect();
  // Returns the smoothed image that a keypoint was detected in.
  SiftLevel Level(const VlSiftKeypoint& keypoint) const;

 private:
  void GoTo(int octave);
  void FillFirstLevel();
  void SmoothTo(int level, const float* image, double stddev_px);

  std::unique_ptr<VlSiftFilt, void (*)(VlSiftFilt*)> filter_;
  std::vector<std::unique_ptr<float[]>> octaves_;  // the smoothed levels of each, in place of VLFeat's own
  std::vector<float> image_;
  IdleThreads* idle_threads_;
};

}  // namespace lazyloc
