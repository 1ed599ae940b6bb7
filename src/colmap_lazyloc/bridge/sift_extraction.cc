#include <algorithm>
#include <array>
#include <cmath>

#include <colmap/feature/utils.h>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/bridge/sift_descriptor.h"
#include "colmap_lazyloc/bridge/sift_detection.h"
#include "colmap_lazyloc/bridge/sift_pyramid.h"

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
    const int turned_angle = (kNumAngularBins - angle) % kNumAngularBins;
    turned.at(i - angle + turned_angle) = bytes(0, i);
  }
  return turned;
}

struct DetectedKeypoint {
  const SiftOctave* octave;
  int level;
  SiftKeypoint keypoint;  // in pixels of the octave
};

KeypointFeatures Describe(const DetectedKeypoint& detected, bool is_upright) {
  const SiftLevel level = detected.octave->Level(detected.level);
  const SiftKeypoint& keypoint = detected.keypoint;
  const auto pixel = static_cast<float>(std::pow(2.0, detected.octave->index));
  std::vector<double> orientations = is_upright ? std::vector<double>{0.0} : FindOrientations(level, keypoint);
  orientations.resize(std::min(orientations.size(), static_cast<size_t>(kColmapSift.max_num_orientations)));
  KeypointFeatures features;
  for (const double orientation : orientations) {
    features.keypoints.emplace_back(keypoint.x * pixel + 0.5f, keypoint.y * pixel + 0.5f, keypoint.scale * pixel,
                                    static_cast<float>(orientation));
    const bool is_described = keypoint.PixelY() < level.height - 1;
    features.descriptors.push_back(is_described ? ToBytes(DescribeKeypoint(level, keypoint, orientation))
                                                : DescriptorBytes{});
  }
  return features;
}

// Returns the keypoints of the coarsest levels, which are kept until there are more than the maximum, the finest first.
// Does not detect those of octaves of which nothing is kept.
std::vector<DetectedKeypoint> DetectCoarsest(const std::vector<SiftOctave>& octaves, int max_num_features,
                                             IdleThreads* idle_threads) {
  const auto max_num = static_cast<size_t>(max_num_features);
  std::vector<DetectedKeypoint> keypoints;  // in reverse order
  for (auto octave = octaves.rbegin(); octave != octaves.rend() && keypoints.size() <= max_num; ++octave) {
    const OctaveKeypoints detected =
        DetectKeypoints(*octave, kColmapSift.peak_threshold, kColmapSift.edge_threshold, idle_threads);
    for (int i = kNumKeypointLevels - 1; i >= 0 && keypoints.size() <= max_num; --i) {
      const std::vector<SiftKeypoint>& of_level = detected[static_cast<size_t>(i)];
      for (auto keypoint = of_level.rbegin(); keypoint != of_level.rend(); ++keypoint) {
        keypoints.push_back({&*octave, kFirstKeypointLevel + i, *keypoint});
      }
    }
  }
  std::reverse(keypoints.begin(), keypoints.end());
  return keypoints;
}

// Returns the features of each keypoint.
std::vector<KeypointFeatures> DescribeAll(const std::vector<DetectedKeypoint>& keypoints, bool is_upright,
                                          IdleThreads* idle_threads) {
  std::vector<KeypointFeatures> features(keypoints.size());
  ParallelForRanges(
      keypoints.size(),
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) features[i] = Describe(keypoints[i], is_upright);
      },
      idle_threads);
  return features;
}

}  // namespace

std::optional<SiftExtractionOptions> PlainSiftOptions(const colmap::SiftExtractionOptions& options) {
  const bool is_plain =
      !options.estimate_affine_shape && !options.domain_size_pooling && !options.force_covariant_extractor &&
      options.normalization == kColmapSift.normalization && options.first_octave >= -1 &&
      options.num_octaves == kColmapSift.num_octaves && options.octave_resolution == kColmapSift.octave_resolution &&
      options.peak_threshold == kColmapSift.peak_threshold && options.edge_threshold == kColmapSift.edge_threshold &&
      options.max_num_orientations == kColmapSift.max_num_orientations;
  if (!is_plain) return std::nullopt;
  SiftExtractionOptions plain;
  plain.max_num_features = options.max_num_features;
  plain.first_octave = options.first_octave;
  plain.upright = options.upright;
  return plain;
}

void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  const std::vector<SiftOctave> octaves =
      MakeOctaves(grey, width, height, options.first_octave, kColmapSift.num_octaves, idle_threads);
  const std::vector<KeypointFeatures> features_of =
      DescribeAll(DetectCoarsest(octaves, options.max_num_features, idle_threads), options.upright, idle_threads);
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
