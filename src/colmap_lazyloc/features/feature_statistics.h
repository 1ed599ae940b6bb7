#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// What the features of the database images have in common. Photos with features alike are faster, because features that
// are finer or more than those of the database images seldom have a counterpart there.
struct FeatureStatistics {
  size_t max_num_features = 0;  // 95 % of the images have at most as many; 0 if unknown
  double min_scale_ratio = 0;   // scale over focal length that 95 % of the keypoints exceed; 0 if unknown
};

// The size at which a photo shows things.
struct PhotoScale {
  double size_px = 0;  // of the longer side
  double focal_length_px = 0;
};

// Returns the scale of a keypoint in pixels.
float KeypointScale(const Keypoint& keypoint);

// Returns the indices of the largest values in ascending order; of equal values, those with the smaller indices.
template <typename Value>
std::vector<size_t> IndicesOfLargest(const std::vector<Value>& values, size_t max_num) {
  std::vector<size_t> indices(values.size());
  std::iota(indices.begin(), indices.end(), 0);
  std::stable_sort(indices.begin(), indices.end(), [&](size_t a, size_t b) { return values[a] > values[b]; });
  indices.resize(std::min(indices.size(), max_num));
  std::sort(indices.begin(), indices.end());
  return indices;
}

// Returns the indices of the keypoints of the largest scales in ascending order; of equal scales, those that come
// first.
std::vector<size_t> IndicesOfLargest(const std::vector<Keypoint>& keypoints, size_t max_num);

// Returns the statistics of database images. num_features: of each image. scale_ratios: of keypoints.
FeatureStatistics MeasureFeatures(std::vector<size_t> num_features, std::vector<double> scale_ratios);

// Replaces the automatic values of the options.
SiftExtractionOptions ChooseExtraction(const SiftExtractionOptions& options, const FeatureStatistics& database,
                                       const PhotoScale& photo);

// Extracts the features of a photo. With an automatic number, keeps those with the largest scales, because COLMAP's
// maximum counts neither a keypoint's further orientations nor the rest of a level of the pyramid. Uses idle threads,
// too.
Features ExtractLikeDatabase(const PhotoFile& photo, double focal_length_px, const SiftExtractionOptions& options,
                             const FeatureStatistics& database, IdleThreads* idle_threads);

}  // namespace lazyloc
