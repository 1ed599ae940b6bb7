#pragma once

#include <cstdint>
#include <fstream>
#include <memory>
#include <utility>
#include <vector>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Names the form of what Write writes: it differs between generations of COLMAP.
extern const char* const kVisualIndexFormat;

// COLMAP's inverted index of visual words with Hamming embedding (Schoenberger et al., ACCV 2016), over a vocabulary of
// its own descriptors. The same input gives the same index and the same answers.
class VisualIndex {
 public:
  // training: descriptors of 128 columns, at least one; the vocabulary has at most num_words words.
  static VisualIndex Train(const Descriptors& training, int num_words, uint32_t seed, IdleThreads* idle_threads);
  // Reads what Write has written; the file must be whole.
  static VisualIndex Read(std::ifstream* file);
  ~VisualIndex();
  VisualIndex(VisualIndex&&) noexcept;

  void Write(std::ofstream* file) const;

  // image_id: not added before.
  void Add(int image_id, const Descriptors& descriptors, IdleThreads* idle_threads);
  // After the last Add, before the first Query.
  void Finalize();
  // The ids and scores of all images that share a word with the query, best first. Thread-safe.
  std::vector<std::pair<int, float>> Query(const Descriptors& descriptors, IdleThreads* idle_threads) const;

 private:
  struct Impl;
  explicit VisualIndex(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
