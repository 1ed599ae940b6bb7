#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/bridge/sift_descriptor.h"
#include "colmap_lazyloc/bridge/vlfeat.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// VLFeat's SIFT of one image, octave by octave. VLFeat detects the keypoints and finds their orientations. What takes
// longest is our own: smoothing, gradients and descriptors are made by the same steps, but several pixels at a time.
class SiftFilter {
 public:
  // grey: width * height values, row by row.
  SiftFilter(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
             IdleThreads* idle_threads);

  // Goes to the first or next octave and detects its keypoints. Returns false if there is none.
  bool DetectNextOctave();
  // Returns the keypoints in the octave, level by level.
  std::vector<VlSiftKeypoint> Keypoints() const;
  // Returns at most max_num orientations of a keypoint in the octave. Thread-safe, like Describe.
  std::vector<double> Orientations(const VlSiftKeypoint& keypoint, int max_num) const;
  // Returns false if the keypoint is too near to the lower border.
  bool Describe(const VlSiftKeypoint& keypoint, double orientation, SiftHistogram* descriptor) const;

 private:
  void BeginOctave(int octave);
  void FillFirstLevel();
  void ComputeGradients();
  GradientImage Gradients(int level) const;
  void SmoothTo(int level, const float* image, double stddev_px);

  std::unique_ptr<VlSiftFilt, void (*)(VlSiftFilt*)> filter_;
  std::vector<float> image_;
  IdleThreads* idle_threads_;
  bool has_octave_ = false;
};

}  // namespace lazyloc
