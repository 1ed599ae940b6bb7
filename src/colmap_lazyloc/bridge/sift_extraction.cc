#include <algorithm>
#include <array>
#include <cmath>

#include <colmap/feature/utils.h>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/bridge/sift_descriptor.h"
#include "colmap_lazyloc/bridge/sift_filter.h"

namespace lazyloc {
namespace {

constexpr int kNumColumns = kDescriptorLength;
using DescriptorBytes = std::array<uint8_t, kNumColumns>;
using FloatDescriptor =
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;  // COLMAP's, with one row

// The features of one keypoint: one per orientation.
struct KeypointFeatures {
  colmap::FeatureKeypoints keypoints;
  std::vector<DescriptorBytes> descriptors;
};

// Returns the bytes of COLMAP's descriptors: normalized, and with the orientations in the other sense of rotation.
DescriptorBytes ToBytes(const SiftHistogram& histogram) {
  FloatDescriptor values = Eigen::Map<const Eigen::RowVectorXf>(histogram.data(), kNumColumns);
  colmap::L1RootNormalizeFeatureDescriptors(&values);
  const Descriptors bytes = colmap::FeatureDescriptorsToUnsignedByte(values);
  DescriptorBytes turned;
  for (int i = 0; i < kNumColumns; ++i) {
    const int angle = i % kNumAngularBins;
    turned[static_cast<size_t>(i - angle + (kNumAngularBins - angle) % kNumAngularBins)] = bytes(0, i);
  }
  return turned;
}

KeypointFeatures Describe(const VlSiftKeypoint& keypoint, bool is_upright, const SiftLevel& level) {
  const auto pixel = static_cast<float>(std::pow(2.0, keypoint.o));
  const SiftKeypoint in_level = {keypoint.x / pixel, keypoint.y / pixel, keypoint.sigma / pixel};
  std::vector<double> orientations = is_upright ? std::vector<double>{0.0} : FindOrientations(level, in_level);
  orientations.resize(std::min(orientations.size(), static_cast<size_t>(kColmapSift.max_num_orientations)));
  KeypointFeatures features;
  for (const double orientation : orientations) {
    features.keypoints.emplace_back(keypoint.x + 0.5f, keypoint.y + 0.5f, keypoint.sigma,
                                    static_cast<float>(orientation));
    const bool is_described = static_cast<int>(in_level.y + 0.5) < level.height - 1;
    features.descriptors.push_back(is_described ? ToBytes(DescribeKeypoint(level, in_level, orientation))
                                                : DescriptorBytes{});
  }
  return features;
}

// Removes the finest levels while the others together exceed the maximum number. Takes the keypoints as Detect gives
// them.
std::vector<VlSiftKeypoint> KeepCoarsest(std::vector<VlSiftKeypoint> keypoints, int max_num_features) {
  const auto max_num = static_cast<size_t>(max_num_features);
  if (keypoints.size() <= max_num) return keypoints;
  auto begin = keypoints.end() - static_cast<std::ptrdiff_t>(max_num) - 1;
  while (begin != keypoints.begin() && (begin - 1)->o == begin->o && (begin - 1)->is == begin->is) --begin;
  keypoints.erase(keypoints.begin(), begin);
  return keypoints;
}

std::vector<KeypointFeatures> DescribeAll(const std::vector<VlSiftKeypoint>& keypoints, bool is_upright,
                                          const SiftFilter& filter, IdleThreads* idle_threads) {
  std::vector<KeypointFeatures> features(keypoints.size());
  ParallelForRanges(
      keypoints.size(),
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          features[i] = Describe(keypoints[i], is_upright, filter.Level(keypoints[i]));
        }
      },
      idle_threads);
  return features;
}

}  // namespace

void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  SiftFilter filter(grey, width, height, options, idle_threads);
  // Detects all before any is described, because the finest levels are the largest and often not kept.
  const std::vector<KeypointFeatures> features_of =
      DescribeAll(KeepCoarsest(filter.Detect(), options.max_num_features), options.upright, filter, idle_threads);
  keypoints->clear();
  for (const KeypointFeatures& features : features_of) {
    keypoints->insert(keypoints->end(), features.keypoints.begin(), features.keypoints.end());
  }
  descriptors->resize(static_cast<Eigen::Index>(keypoints->size()), kNumColumns);
  uint8_t* row = descriptors->data();
  for (const KeypointFeatures& features : features_of) {
    for (const DescriptorBytes& bytes : features.descriptors) row = std::copy(bytes.begin(), bytes.end(), row);
  }
}

}  // namespace lazyloc
