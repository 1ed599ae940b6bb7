#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <cstdlib>
#include <mutex>

#include <flann/flann.hpp>

#include "colmap_lazyloc/bridge/visual_index.h"

namespace lazyloc {

const char* const kVisualIndexFormat = "COLMAP-3";

namespace {

constexpr int kBranching = 32;  // children of a node in the tree of clusters

// Casts const away because FLANN, which only reads the descriptors, takes no const data.
flann::Matrix<uint8_t> ToFlann(const Descriptors& descriptors) {
  return {const_cast<uint8_t*>(descriptors.data()), static_cast<size_t>(descriptors.rows()), kDescriptorLength};
}

}  // namespace

// Clusters with FLANN's hierarchical k-means.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed) {
  num_words = std::max(2, std::min<int>(num_words, descriptors.rows()));
  // Excludes other threads, because FLANN draws from rand(), whose state is shared by the whole program.
  static std::mutex mutex;
  const std::lock_guard<std::mutex> lock(mutex);
  std::srand(seed);
  Eigen::Matrix<float, Eigen::Dynamic, kDescriptorLength, Eigen::RowMajor> centres(num_words, kDescriptorLength);
  flann::Matrix<float> flann_centres(centres.data(), centres.rows(), kDescriptorLength);
  flann::KMeansIndexParams params(std::min(kBranching, num_words), kNumClusterings, flann::FLANN_CENTERS_KMEANSPP);
  const int num_centres =
      flann::hierarchicalClustering<flann::L2<uint8_t>>(ToFlann(descriptors), flann_centres, params);
  return centres.topRows(num_centres).array().round().cast<uint8_t>();
}

}  // namespace lazyloc
