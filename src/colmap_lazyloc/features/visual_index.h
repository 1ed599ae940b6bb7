#pragma once

#include <array>
#include <cstdint>
#include <fstream>
#include <utility>
#include <vector>

#include "colmap_lazyloc/features/visual_words.h"

namespace lazyloc {

// Index for image retrieval: inverted files of visual words with Hamming embedding. A feature of the query votes for
// the images that have features of the same word with a similar signature. The same input gives the same index and the
// same answers. Jegou, Douze and Schmid, Hamming embedding and weak geometric consistency for large scale image search,
// ECCV 2008, with the votes of Arandjelovic and Zisserman, DisLocation: Scalable descriptor distinctiveness for
// location recognition, ACCV 2014.
class VisualIndex {
 public:
  explicit VisualIndex(VisualWords words);
  // Reads what Write has written. The caller must make sure that the file is complete and not damaged.
  static VisualIndex Read(std::ifstream* file);

  void Write(std::ofstream* file) const;

  // Adds an image. image_id: positive, and larger than those that were added before.
  void Add(int image_id, const Descriptors& descriptors, IdleThreads* idle_threads);
  // Returns the ids and scores of all images with a vote, the highest score first. The score is the sum of the votes
  // over the root of the number of features of the image. Thread-safe.
  std::vector<std::pair<int, float>> Query(const Descriptors& descriptors, IdleThreads* idle_threads) const;

 private:
  static constexpr int kNumBits = 64;
  using Projections = std::array<int16_t, kNumBits>;

  // The features of a word, by image.
  struct InvertedFile {
    std::vector<int32_t> image_ids;
    std::vector<uint64_t> signatures;
  };

  void CountFeature(int image_id);
  static Projections Project(const uint8_t* descriptor);
  // Returns the signs of the differences of a descriptor's projections to those of its word.
  uint64_t Signature(const uint8_t* descriptor, int word) const;
  // Adds the votes of a feature to the scores.
  static void Vote(const InvertedFile& file, uint64_t signature, std::vector<float>* scores);

  VisualWords words_;
  std::vector<Projections> projected_words_;
  std::vector<InvertedFile> files_;      // of each word
  std::vector<int> num_features_ = {0};  // of each image, by id
};

}  // namespace lazyloc
