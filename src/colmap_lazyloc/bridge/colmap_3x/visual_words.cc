#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <cstdlib>
#include <mutex>

#include <flann/flann.hpp>

#include "colmap_lazyloc/bridge/visual_index.h"

namespace lazyloc {

const char* const kVisualIndexFormat = "COLMAP-3";

namespace {

constexpr int kDim = 128;
constexpr int kNumChecks = 256;  // leaves that the search for a word visits, as in COLMAP's visual index
constexpr int kBranching = 32;   // of the tree of clusters, and of the tree that words are searched in
constexpr int kNumIterations = 11;

// FLANN's clusters come from the program's one rand(): to give the same ones again, nobody else may draw from it
// meanwhile. (Its k-d trees are shuffled by the machine's random device, so they are of no use.)
class FlannLock {
 public:
  explicit FlannLock(uint32_t seed) : lock_(Mutex()) { std::srand(seed); }

 private:
  static std::mutex& Mutex() {
    static std::mutex mutex;
    return mutex;
  }
  std::lock_guard<std::mutex> lock_;
};

// FLANN only reads it, but has no type that says so.
flann::Matrix<uint8_t> ToFlann(const Descriptors& descriptors) {
  return {const_cast<uint8_t*>(descriptors.data()), static_cast<size_t>(descriptors.rows()), kDim};
}

}  // namespace

struct VisualWords::Search {
  explicit Search(const Descriptors& words)
      : tree(ToFlann(words), flann::KMeansIndexParams(kBranching, kNumIterations, flann::FLANN_CENTERS_KMEANSPP)) {
    const FlannLock lock(/*seed=*/0);
    tree.buildIndex();
  }

  flann::Index<flann::L2<uint8_t>> tree;
};

VisualWords::VisualWords(Descriptors words) : words_(std::move(words)), search_(std::make_unique<Search>(words_)) {}
VisualWords::~VisualWords() = default;

Eigen::MatrixXi VisualWords::Find(const Descriptors& descriptors, int num_neighbors) const {
  num_neighbors = std::min<int>(num_neighbors, words_.rows());
  Eigen::Matrix<int, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> ids(descriptors.rows(), num_neighbors);
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> distances(descriptors.rows(), num_neighbors);
  flann::Matrix<int> flann_ids(ids.data(), ids.rows(), num_neighbors);
  flann::Matrix<float> flann_distances(distances.data(), distances.rows(), num_neighbors);
  if (descriptors.rows() > 0) {
    search_->tree.knnSearch(ToFlann(descriptors), flann_ids, flann_distances, num_neighbors,
                            flann::SearchParams(kNumChecks));
  }
  return ids;
}

// Hierarchical k-means.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed) {
  num_words = std::max(2, std::min<int>(num_words, descriptors.rows()));
  const FlannLock lock(seed);
  Eigen::Matrix<float, Eigen::Dynamic, kDim, Eigen::RowMajor> centres(num_words, kDim);
  flann::Matrix<float> flann_centres(centres.data(), centres.rows(), kDim);
  flann::KMeansIndexParams params(std::min(kBranching, num_words), kNumIterations, flann::FLANN_CENTERS_KMEANSPP);
  const int num_centres =
      flann::hierarchicalClustering<flann::L2<uint8_t>>(ToFlann(descriptors), flann_centres, params);
  return centres.topRows(num_centres).array().round().cast<uint8_t>();
}

}  // namespace lazyloc
