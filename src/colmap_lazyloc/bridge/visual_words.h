#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Vocabulary of visual words, which are centres of clusters of descriptors with 128 columns.
class VisualWords {
 public:
  explicit VisualWords(Descriptors words);

  const Descriptors& Words() const { return words_; }
  // Returns the indices of the nearest words of each descriptor: one row per descriptor, the nearest word in column 0,
  // min(num_neighbors, number of words) columns. The search is exact. Uses idle threads, too. Thread-safe.
  Eigen::MatrixXi Find(const Descriptors& descriptors, int num_neighbors, IdleThreads* idle_threads) const;

 private:
  void FindOnOneThread(const Descriptors& descriptors, Eigen::Ref<Eigen::MatrixXi> ids) const;

  Descriptors words_;
  DescriptorBlocks blocks_;
  std::vector<int32_t> squared_norms_;  // one entry per word in blocks_
};

constexpr int kNumClusterings = 11;  // iterations of k-means, as many as COLMAP's

// Clusters descriptors with the library that COLMAP uses (FLANN or faiss). Returns at most max(num_words, 2) words. The
// same input gives the same words.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed);

}  // namespace lazyloc
