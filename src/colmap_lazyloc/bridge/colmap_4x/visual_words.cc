#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>

#include <faiss/Clustering.h>
#include <faiss/IndexFlat.h>

#include "colmap_lazyloc/bridge/visual_index.h"

namespace lazyloc {

const char* const kVisualIndexFormat = "COLMAP-4";

namespace {

using FloatDescriptors = Eigen::Matrix<float, Eigen::Dynamic, kDescriptorLength, Eigen::RowMajor>;

}  // namespace

Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed) {
  faiss::ClusteringParameters params;
  params.niter = kNumClusterings;
  params.seed = static_cast<int>(seed);
  params.min_points_per_centroid = 1;  // keeps faiss from printing a warning
  faiss::Clustering clustering(kDescriptorLength, std::min<int>(num_words, descriptors.rows()), params);
  faiss::IndexFlatL2 index(kDescriptorLength);
  const FloatDescriptors points = descriptors.cast<float>();
  clustering.train(points.rows(), points.data(), index);
  const Eigen::Map<const FloatDescriptors> centres(clustering.centroids.data(), clustering.k, kDescriptorLength);
  return centres.array().round().cast<uint8_t>();
}

}  // namespace lazyloc
