#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include <faiss/Clustering.h>
#include <faiss/IndexFlat.h>

#include "colmap_lazyloc/bridge/visual_index.h"

namespace lazyloc {

const char* const kVisualIndexFormat = "COLMAP-4";

namespace {

constexpr int kDim = 128;
constexpr int kNumIterations = 11;

using FloatDescriptors = Eigen::Matrix<float, Eigen::Dynamic, kDim, Eigen::RowMajor>;

}  // namespace

struct VisualWords::Search {
  faiss::IndexFlatL2 index{kDim};  // exact
};

VisualWords::VisualWords(Descriptors words) : words_(std::move(words)), search_(std::make_unique<Search>()) {
  const FloatDescriptors points = words_.cast<float>();
  search_->index.add(points.rows(), points.data());
}
VisualWords::~VisualWords() = default;

Eigen::MatrixXi VisualWords::Find(const Descriptors& descriptors, int num_neighbors) const {
  num_neighbors = std::min<int>(num_neighbors, words_.rows());
  Eigen::Matrix<int64_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> ids(descriptors.rows(), num_neighbors);
  std::vector<float> distances(ids.size());
  const FloatDescriptors points = descriptors.cast<float>();
  if (points.rows() > 0)
    search_->index.search(points.rows(), points.data(), num_neighbors, distances.data(), ids.data());
  return ids.cast<int>();
}

Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed) {
  faiss::ClusteringParameters params;
  params.niter = kNumIterations;
  params.seed = static_cast<int>(seed);
  params.min_points_per_centroid = 1;  // no warning
  faiss::Clustering clustering(kDim, std::min<int>(num_words, descriptors.rows()), params);
  faiss::IndexFlatL2 index(kDim);
  const FloatDescriptors points = descriptors.cast<float>();
  clustering.train(points.rows(), points.data(), index);
  const Eigen::Map<const FloatDescriptors> centres(clustering.centroids.data(), clustering.k, kDim);
  return centres.array().round().cast<uint8_t>();
}

}  // namespace lazyloc
