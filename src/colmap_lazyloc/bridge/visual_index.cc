#include "colmap_lazyloc/bridge/visual_index.h"

#include <algorithm>

#include <colmap/retrieval/inverted_index.h>

#include "colmap_lazyloc/bridge/random_numbers.h"
#include "colmap_lazyloc/bridge/visual_words.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int kNumWordsOfQuery = 5;  // nearest words that a query feature is looked up under

using InvertedIndex = colmap::retrieval::InvertedIndex<uint8_t, kDescriptorLength, /*kEmbeddingDim=*/64>;
using WordId = std::remove_const_t<decltype(InvertedIndex::kInvalidWordId)>;  // 32 bits in COLMAP 3, 64 in COLMAP 4

}  // namespace

struct VisualIndex::Impl {
  explicit Impl(Descriptors descriptors) : words(std::move(descriptors)) {}

  auto FindWords(const Descriptors& descriptors, int num_neighbors, IdleThreads* idle_threads) const {
    return words.Find(descriptors, num_neighbors, idle_threads).cast<WordId>().eval();
  }

  VisualWords words;
  InvertedIndex inverted_index;
};

VisualIndex::VisualIndex(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
VisualIndex::~VisualIndex() = default;
VisualIndex::VisualIndex(VisualIndex&&) noexcept = default;

VisualIndex VisualIndex::Train(const Descriptors& training, int num_words, uint32_t seed, IdleThreads* idle_threads) {
  LAZYLOC_CHECK(training.rows() > 0 && training.cols() == kDescriptorLength);
  auto impl = std::make_unique<Impl>(ClusterWords(training, num_words, seed));
  impl->inverted_index.Initialize(static_cast<int>(impl->words.Words().rows()));
  SeedRandomNumbers(seed);
  impl->inverted_index.GenerateHammingEmbeddingProjection();
  impl->inverted_index.ComputeHammingEmbedding(training, impl->FindWords(training, 1, idle_threads));
  return VisualIndex(std::move(impl));
}

void VisualIndex::Add(int image_id, const Descriptors& descriptors, IdleThreads* idle_threads) {
  // Enters each feature under its nearest word.
  const auto word_ids = impl_->FindWords(descriptors, 1, idle_threads);
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    impl_->inverted_index.AddEntry(image_id, word_ids(i, 0), i, descriptors.row(i), {});
  }
}

void VisualIndex::Finalize() { impl_->inverted_index.Finalize(); }

std::vector<std::pair<int, float>> VisualIndex::Query(const Descriptors& descriptors, IdleThreads* idle_threads) const {
  std::vector<colmap::retrieval::ImageScore> scores;
  impl_->inverted_index.Query(descriptors, impl_->FindWords(descriptors, kNumWordsOfQuery, idle_threads), &scores);
  std::vector<std::pair<int, float>> ranked;
  for (const colmap::retrieval::ImageScore& score : scores) ranked.emplace_back(score.image_id, score.score);
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : a.first < b.first;
  });
  return ranked;
}

void VisualIndex::Write(std::ofstream* file) const {
  const Descriptors& words = impl_->words.Words();
  const uint64_t num_words = static_cast<uint64_t>(words.rows());
  file->write(reinterpret_cast<const char*>(&num_words), sizeof(num_words));
  file->write(reinterpret_cast<const char*>(words.data()), words.size());
  impl_->inverted_index.Write(file);
}

VisualIndex VisualIndex::Read(std::ifstream* file) {
  uint64_t num_words = 0;
  file->read(reinterpret_cast<char*>(&num_words), sizeof(num_words));
  Descriptors words(static_cast<Eigen::Index>(num_words), kDescriptorLength);
  file->read(reinterpret_cast<char*>(words.data()), words.size());
  auto impl = std::make_unique<Impl>(std::move(words));
  impl->inverted_index.Read(file);
  return VisualIndex(std::move(impl));
}

}  // namespace lazyloc
