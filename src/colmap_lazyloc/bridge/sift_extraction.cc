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

// The features of one level of the scale space.
using Level = std::vector<KeypointFeatures>;

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

// Appends the levels of the filter's octave that have keypoints.
void AppendLevels(bool is_upright, const SiftFilter& filter, IdleThreads* idle_threads, std::vector<Level>* levels) {
  const std::vector<VlSiftKeypoint> keypoints = filter.Keypoints();
  std::vector<KeypointFeatures> features(keypoints.size());
  ParallelForRanges(
      keypoints.size(),
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) features[i] = Describe(keypoints[i], is_upright, filter);
      },
      idle_threads);
  for (size_t i = 0; i < keypoints.size(); ++i) {
    if (i == 0 || keypoints[i].is != keypoints[i - 1].is) levels->emplace_back();
    levels->back().push_back(std::move(features[i]));
  }
}

// Returns the first of the coarsest levels that together exceed the maximum number of keypoints, or 0.
size_t FirstLevelToKeep(const std::vector<Level>& levels, int max_num_features) {
  size_t num_features = 0;
  for (size_t i = levels.size(); i > 0; --i) {
    num_features += levels[i - 1].size();
    if (num_features > static_cast<size_t>(max_num_features)) return i - 1;
  }
  return 0;
}

}  // namespace

void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  SiftFilter filter(grey, width, height, options, idle_threads);
  std::vector<Level> levels;
  while (filter.DetectNextOctave()) AppendLevels(options.upright, filter, idle_threads, &levels);
  levels.erase(levels.begin(),
               levels.begin() + static_cast<std::ptrdiff_t>(FirstLevelToKeep(levels, options.max_num_features)));
  std::vector<DescriptorBytes> kept;
  keypoints->clear();
  for (const Level& level : levels) {
    for (const KeypointFeatures& features : level) {
      keypoints->insert(keypoints->end(), features.keypoints.begin(), features.keypoints.end());
      kept.insert(kept.end(), features.descriptors.begin(), features.descriptors.end());
    }
  }
  descriptors->resize(static_cast<Eigen::Index>(kept.size()), kNumColumns);
  for (size_t i = 0; i < kept.size(); ++i) {
    std::copy(kept[i].begin(), kept[i].end(), descriptors->row(static_cast<Eigen::Index>(i)).data());
  }
}

}  // namespace lazyloc
