#pragma once

#include <cstdint>
#include <fstream>
#include <memory>
#include <utility>
#include <vector>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Name of the format of VisualIndex::Write, which differs between COLMAP 3 and COLMAP 4.
extern const char* const kVisualIndexFormat;

// Index for image retrieval: COLMAP's inverted index of visual words with Hamming embedding. The vocabulary is trained
// on descriptors of the indexed images. The same input gives the same index and the same answers. Schoenberger et al.,
// A Vote-and-Verify Strategy for Fast Spatial Verification in Image Retrieval, ACCV 2016.
class VisualIndex {
 public:
  // Clusters the descriptors `training` (at least one row, 128 columns) into a vocabulary of at most num_words words.
  static VisualIndex Train(const Descriptors& training, int num_words, uint32_t seed, IdleThreads* idle_threads);
  // Reads what Write has written. The caller must make sure that the file is complete and not damaged.
  static VisualIndex Read(std::ifstream* file);
  ~VisualIndex();
  VisualIndex(VisualIndex&&) noexcept;

  void Write(std::ofstream* file) const;

  // Adds an image. image_id: one that was not added before.
  void Add(int image_id, const Descriptors& descriptors, IdleThreads* idle_threads);
  // Call it after the last Add and before the first Query.
  void Finalize();
  // Returns the ids and scores of all images that share a word with the query, the highest score first. Thread-safe.
  std::vector<std::pair<int, float>> Query(const Descriptors& descriptors, IdleThreads* idle_threads) const;

 private:
  struct Impl;
  explicit VisualIndex(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
