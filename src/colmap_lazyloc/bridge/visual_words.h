#pragma once

#include <cstdint>
#include <memory>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// A vocabulary of visual words: centres of clusters of descriptors with 128 columns. Clustering and search are those of the
// library that COLMAP uses itself. The same input gives the same words and the same neighbours.
class VisualWords {
 public:
  explicit VisualWords(Descriptors words);
  ~VisualWords();

  const Descriptors& Words() const { return words_; }
  // Indices of the words that are nearest to each descriptor, a row per descriptor; fewer columns than num_neighbors where
  // there are fewer words. Thread-safe.
  Eigen::MatrixXi Find(const Descriptors& descriptors, int num_neighbors) const;

 private:
  Descriptors words_;
  struct Search;
  std::unique_ptr<Search> search_;
};

// At least two words (with one descriptor: one), at most num_words.
Descriptors ClusterWords(const Descriptors& descriptors, int num_words, uint32_t seed);

}  // namespace lazyloc
