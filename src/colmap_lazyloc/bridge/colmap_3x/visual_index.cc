#include "colmap_lazyloc/bridge/visual_index.h"

#include <algorithm>
#include <cstdlib>
#include <mutex>

#include <colmap/math/random.h>
#include <colmap/retrieval/inverted_index.h>
#include <flann/flann.hpp>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

const char* const kVisualIndexFormat = "COLMAP-3";

namespace {

constexpr int kDim = 128;
constexpr int kNumChecks = 256;         // leaves that the search for a word visits, as in COLMAP's visual index
constexpr int kNumWordsOfDatabase = 1;  // nearest words that a database feature is entered under
constexpr int kNumWordsOfQuery = 5;     // nearest words that a query feature is looked up under
constexpr int kBranching = 32;          // of the tree of clusters, and of the tree that words are searched in
constexpr int kNumIterations = 11;

using InvertedIndex = colmap::retrieval::InvertedIndex<uint8_t, kDim, /*kEmbeddingDim=*/64>;
using WordTree = flann::Index<flann::L2<uint8_t>>;

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

// Hierarchical k-means.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words) {
  Eigen::Matrix<float, Eigen::Dynamic, kDim, Eigen::RowMajor> centres(num_words, kDim);
  flann::Matrix<float> flann_centres(centres.data(), centres.rows(), kDim);
  flann::KMeansIndexParams params(std::min(kBranching, num_words), kNumIterations, flann::FLANN_CENTERS_KMEANSPP);
  const int num_centres =
      flann::hierarchicalClustering<flann::L2<uint8_t>>(ToFlann(descriptors), flann_centres, params);
  return centres.topRows(num_centres).array().round().cast<uint8_t>();
}

}  // namespace

struct VisualIndex::Impl {
  void BuildTree() {
    const FlannLock lock(/*seed=*/0);
    tree = std::make_unique<WordTree>(
        ToFlann(words), flann::KMeansIndexParams(kBranching, kNumIterations, flann::FLANN_CENTERS_KMEANSPP));
    tree->buildIndex();
  }

  Eigen::MatrixXi FindWords(const Descriptors& descriptors, int num_neighbors) const {
    num_neighbors = std::min<int>(num_neighbors, words.rows());
    Eigen::Matrix<int, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> ids(descriptors.rows(), num_neighbors);
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> distances(descriptors.rows(), num_neighbors);
    flann::Matrix<int> flann_ids(ids.data(), ids.rows(), num_neighbors);
    flann::Matrix<float> flann_distances(distances.data(), distances.rows(), num_neighbors);
    if (descriptors.rows() > 0) {
      tree->knnSearch(ToFlann(descriptors), flann_ids, flann_distances, num_neighbors, flann::SearchParams(kNumChecks));
    }
    return ids;
  }

  Descriptors words;
  std::unique_ptr<WordTree> tree;
  InvertedIndex inverted_index;
};

VisualIndex::VisualIndex() : impl_(std::make_unique<Impl>()) {}
VisualIndex::~VisualIndex() = default;
VisualIndex::VisualIndex(VisualIndex&&) noexcept = default;

VisualIndex VisualIndex::Train(const Descriptors& training, int num_words, uint32_t seed) {
  LAZYLOC_CHECK(training.rows() > 0 && training.cols() == kDim);
  VisualIndex index;
  Impl& impl = *index.impl_;
  {
    const FlannLock lock(seed);
    impl.words = ClusterWords(training, std::max(2, std::min<int>(num_words, training.rows())));
  }
  impl.BuildTree();
  impl.inverted_index.Initialize(static_cast<int>(impl.words.rows()));
  colmap::SetPRNGSeed(seed);
  impl.inverted_index.GenerateHammingEmbeddingProjection();
  impl.inverted_index.ComputeHammingEmbedding(training, impl.FindWords(training, 1));
  return index;
}

void VisualIndex::Add(int image_id, const Descriptors& descriptors) {
  const Eigen::MatrixXi word_ids = impl_->FindWords(descriptors, kNumWordsOfDatabase);
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    for (Eigen::Index k = 0; k < word_ids.cols(); ++k) {
      impl_->inverted_index.AddEntry(image_id, word_ids(i, k), i, descriptors.row(i), {});
    }
  }
}

void VisualIndex::Finalize() { impl_->inverted_index.Finalize(); }

std::vector<std::pair<int, float>> VisualIndex::Query(const Descriptors& descriptors) const {
  std::vector<colmap::retrieval::ImageScore> scores;
  impl_->inverted_index.Query(descriptors, impl_->FindWords(descriptors, kNumWordsOfQuery), &scores);
  std::vector<std::pair<int, float>> ranked;
  for (const colmap::retrieval::ImageScore& score : scores) ranked.emplace_back(score.image_id, score.score);
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : a.first < b.first;
  });
  return ranked;
}

void VisualIndex::Write(std::ofstream* file) const {
  const uint64_t num_words = static_cast<uint64_t>(impl_->words.rows());
  file->write(reinterpret_cast<const char*>(&num_words), sizeof(num_words));
  file->write(reinterpret_cast<const char*>(impl_->words.data()), impl_->words.size());
  impl_->inverted_index.Write(file);
}

VisualIndex VisualIndex::Read(std::ifstream* file) {
  VisualIndex index;
  uint64_t num_words = 0;
  file->read(reinterpret_cast<char*>(&num_words), sizeof(num_words));
  index.impl_->words.resize(static_cast<Eigen::Index>(num_words), kDim);
  file->read(reinterpret_cast<char*>(index.impl_->words.data()), index.impl_->words.size());
  index.impl_->BuildTree();
  index.impl_->inverted_index.Read(file);
  return index;
}

}  // namespace lazyloc
