#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#if __has_include("thirdparty/VLFeat/sift.h")
#include "thirdparty/VLFeat/sift.h"
#else
#include <colmap/thirdparty/VLFeat/sift.h>  // of an installed COLMAP
#endif

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// VLFeat's SIFT of one image, octave by octave. Replaces VLFeat's convolution, which takes four times as long as ours,
// by the same sums.
class SiftFilter {
 public:
  // grey: width * height values, row by row.
  SiftFilter(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
             IdleThreads* idle_threads);

  // Goes to the first or next octave and detects its keypoints. Returns false if there is none.
  bool DetectNextOctave();
  // Returns the keypoints in the octave, level by level.
  std::vector<VlSiftKeypoint> Keypoints() const;
  // Returns at most max_num orientations of a keypoint in the octave. Thread-safe after the first call in the octave,
  // which computes the gradients; so is Describe.
  std::vector<double> Orientations(const VlSiftKeypoint& keypoint, int max_num);
  // Sets the 128 values of a descriptor. Leaves them alone if the keypoint is too near to the lower border.
  void Describe(const VlSiftKeypoint& keypoint, double orientation, float* descriptor);

 private:
  void BeginOctave(int octave);
  void FillFirstLevel();
  void SmoothTo(int level, const float* image, double stddev_px);

  std::unique_ptr<VlSiftFilt, void (*)(VlSiftFilt*)> filter_;
  std::vector<float> image_;
  IdleThreads* idle_threads_;
  bool has_octave_ = false;
};

}  // namespace lazyloc
