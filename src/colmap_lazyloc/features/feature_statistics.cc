#include "colmap_lazyloc/features/feature_statistics.h"

#include <algorithm>
#include <cmath>

namespace lazyloc {
namespace {

constexpr double kShare = 0.95;      // of the images or keypoints, as feature_statistics.h says
constexpr double kFirstScale = 1.6;  // smallest scale of a keypoint in octave 0, in pixels
constexpr int kMaxFirstOctave = 2;

// Returns 0 for no values.
template <typename Value>
Value Quantile(std::vector<Value> values, double share) {
  if (values.empty()) return 0;
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

void KeepLargestScales(size_t max_num_features, Features* features) {
  if (features->keypoints.size() <= max_num_features) return;
  const std::vector<size_t> kept = IndicesOfLargest(features->keypoints, max_num_features);
  features->descriptors = Descriptors(features->descriptors(kept, Eigen::all));
  for (size_t i = 0; i < kept.size(); ++i) features->keypoints[i] = features->keypoints[kept[i]];  // kept[i] >= i
  features->keypoints.resize(kept.size());
}

}  // namespace

float KeypointScale(const Keypoint& keypoint) {
  return (std::hypot(keypoint.a11, keypoint.a21) + std::hypot(keypoint.a12, keypoint.a22)) / 2;
}

std::vector<size_t> IndicesOfLargest(const std::vector<Keypoint>& keypoints, size_t max_num) {
  std::vector<float> scales;
  scales.reserve(keypoints.size());
  for (const Keypoint& keypoint : keypoints) scales.push_back(KeypointScale(keypoint));
  return IndicesOfLargest(scales, max_num);
}

FeatureStatistics MeasureFeatures(std::vector<size_t> num_features, std::vector<double> scale_ratios) {
  return {Quantile(std::move(num_features), kShare), Quantile(std::move(scale_ratios), 1 - kShare)};
}

SiftExtractionOptions ChooseExtraction(const SiftExtractionOptions& options, const FeatureStatistics& database,
                                       const PhotoScale& photo) {
  SiftExtractionOptions chosen = options;
  if (options.max_num_features == SiftExtractionOptions::kLikeDatabase) {
    const size_t number = database.max_num_features > 0 ? database.max_num_features : kDefaultMaxNumFeatures;
    chosen.max_num_features = static_cast<int>(std::min<size_t>(number, kDefaultMaxNumFeatures));
  }
  if (options.first_octave == SiftExtractionOptions::kOctaveLikeDatabase) {
    // Compares in pixels of the image that the features are extracted from.
    const double focal_length = photo.focal_length_px * std::min(1.0, options.max_image_size / photo.size_px);
    const double octave = std::floor(std::log2(database.min_scale_ratio * focal_length / kFirstScale));
    chosen.first_octave = static_cast<int>(std::clamp<double>(octave, -1, kMaxFirstOctave));
  }
  return chosen;
}

Features ExtractLikeDatabase(const PhotoFile& photo, double focal_length_px, const SiftExtractionOptions& options,
                             const FeatureStatistics& database, IdleThreads* idle_threads) {
  const uint64_t size = std::max(photo.Properties().width, photo.Properties().height);
  const PhotoScale scale = {static_cast<double>(size), focal_length_px};
  Features features = photo.ExtractFeatures(ChooseExtraction(options, database, scale), idle_threads);
  const bool is_automatic = options.max_num_features == SiftExtractionOptions::kLikeDatabase;
  if (is_automatic && database.max_num_features > 0) KeepLargestScales(database.max_num_features, &features);
  return features;
}

}  // namespace lazyloc
