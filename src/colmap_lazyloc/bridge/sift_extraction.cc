#include "colmap_lazyloc/bridge/sift_extraction.h"

#include <algorithm>
#include <array>

#include <colmap/feature/utils.h>

#include "colmap_lazyloc/bridge/sift.h"
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

KeypointFeatures Describe(const VlSiftKeypoint& keypoint, bool is_upright, const SiftFilter& filter) {
  const std::vector<double> orientations =
      is_upright ? std::vector<double>{0.0} : filter.Orientations(keypoint, kColmapSift.max_num_orientations);
  KeypointFeatures features;
  for (const double orientation : orientations) {
    features.keypoints.emplace_back(keypoint.x + 0.5f, keypoint.y + 0.5f, keypoint.sigma,
                                    static_cast<float>(orientation));
    SiftHistogram histogram;
    const bool is_described = filter.Describe(keypoint, orientation, &histogram);
    features.descriptors.push_back(is_described ? ToBytes(histogram) : DescriptorBytes{});
  }
  return features;
}

bool AreOnOneLevel(const VlSiftKeypoint& a, const VlSiftKeypoint& b) { return a.o == b.o && a.is == b.is; }

// Returns the keypoints of the coarsest levels that together exceed the maximum number, or all. They are sorted.
std::vector<VlSiftKeypoint> KeepCoarsest(const std::vector<VlSiftKeypoint>& keypoints, int max_num_features) {
  const auto max_num = static_cast<size_t>(max_num_features);
  if (keypoints.size() <= max_num) return keypoints;
  size_t begin = keypoints.size() - max_num - 1;
  while (begin > 0 && AreOnOneLevel(keypoints[begin - 1], keypoints[begin])) --begin;
  return {keypoints.begin() + static_cast<std::ptrdiff_t>(begin), keypoints.end()};
}

}  // namespace

void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  SiftFilter filter(grey, width, height, options, idle_threads);
  // Detects all before any is described, because the finest levels are the largest and often not kept.
  const std::vector<VlSiftKeypoint> kept_keypoints = KeepCoarsest(filter.Detect(), options.max_num_features);
  std::vector<KeypointFeatures> features_of(kept_keypoints.size());
  for (size_t begin = 0, end = 0; begin < kept_keypoints.size(); begin = end) {
    const int octave = kept_keypoints[begin].o;
    while (end < kept_keypoints.size() && kept_keypoints[end].o == octave) ++end;
    filter.PrepareToDescribe(octave, kept_keypoints[begin].is);
    ParallelForRanges(
        end - begin,
        [&](size_t first, size_t last) {
          for (size_t i = begin + first; i < begin + last; ++i) {
            features_of[i] = Describe(kept_keypoints[i], options.upright, filter);
          }
        },
        idle_threads);
  }
  std::vector<DescriptorBytes> kept;
  keypoints->clear();
  for (const KeypointFeatures& features : features_of) {
    keypoints->insert(keypoints->end(), features.keypoints.begin(), features.keypoints.end());
    kept.insert(kept.end(), features.descriptors.begin(), features.descriptors.end());
  }
  descriptors->resize(static_cast<Eigen::Index>(kept.size()), kNumColumns);
  for (size_t i = 0; i < kept.size(); ++i) {
    std::copy(kept[i].begin(), kept[i].end(), descriptors->row(static_cast<Eigen::Index>(i)).data());
  }
}

}  // namespace lazyloc
