#pragma once

#include <cstdint>
#include <fstream>
#include <vector>

#include "colmap_lazyloc/features/nearest_centres.h"

namespace lazyloc {

// Vocabulary of visual words, which are centres of clusters of descriptors with 128 columns. It has two levels, cells
// and the words of each cell, because a descriptor is then compared with few of the words.
class VisualWords {
 public:
  // Clusters descriptors, at least one, into at most num_words words, but at least one for each cell.
  static VisualWords Train(const Descriptors& descriptors, int num_words, uint32_t seed, IdleThreads* idle_threads);
  // Reads what Write has written. The caller must make sure that the file is complete and not damaged.
  static VisualWords Read(std::ifstream* file);
  // words: of each cell.
  VisualWords(Descriptors cells, const std::vector<Descriptors>& words);

  void Write(std::ofstream* file) const;

  int NumWords() const { return first_words_.back(); }
  // Returns all words, those of a cell one after the other.
  Descriptors Words() const;
  // Returns the index of the nearest word of each descriptor. Considers those of its nearest cells only. Uses idle
  // threads, too. Thread-safe.
  std::vector<int> Find(const Descriptors& descriptors, IdleThreads* idle_threads) const;

 private:
  NearestCentres cells_;
  std::vector<NearestCentres> words_of_cell_;
  std::vector<int> first_words_;  // index of the first word of each cell; then the number of words
};

}  // namespace lazyloc
