#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// A vocabulary of visual words: centres of clusters of descriptors with 128 columns.
class VisualWords {
 public:
  explicit VisualWords(Descriptors words);

  const Descriptors& Words() const { return words_; }
  // Indices of the words that are nearest to each descriptor, the nearest first, a row per descriptor; fewer columns
  // than num_neighbors where there are fewer words. Exact, on idle threads too. Thread-safe.
  Eigen::MatrixXi Find(const Descriptors& descriptors, int num_neighbors, IdleThreads* idle_threads) const;

 private:
  void FindOnOneThread(const DescriptorRows& descriptors, Eigen::Ref<Eigen::MatrixXi> ids) const;

  Descriptors words_;
  DescriptorRows blocks_;
  Eigen::ArrayXi squared_norms_;  // of the rows of blocks_
};

// Clusters by the library that COLMAP uses itself: at least two words (with one descriptor: one), at most num_words.
// The same input gives the same words.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed);

}  // namespace lazyloc
