#include "colmap_lazyloc/features/visual_index.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "colmap_lazyloc/math/vectorized.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// A vote weighs exp(-(d / kSigma)^2), where d bits of the signatures differ, and nothing beyond kMaxDistance.
constexpr double kSigma = 16;
constexpr int kMaxDistance = 24;

std::array<int16_t, kDescriptorLength> RandomSigns() {
  std::mt19937 random;
  std::array<int16_t, kDescriptorLength> signs;
  for (int16_t& sign : signs) sign = random() % 2 == 0 ? 1 : -1;
  return signs;
}

std::array<float, kMaxDistance + 1> WeightsOfVotes() {
  std::array<float, kMaxDistance + 1> weights;
  for (size_t i = 0; i < weights.size(); ++i) {
    weights[i] = static_cast<float>(std::exp(-std::pow(static_cast<double>(i) / kSigma, 2)));
  }
  return weights;
}

template <typename T>
void WriteNumbers(const std::vector<T>& numbers, std::ofstream* file) {
  file->write(reinterpret_cast<const char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(T)));
}

template <typename T>
std::vector<T> ReadNumbers(uint64_t count, std::ifstream* file) {
  std::vector<T> numbers(count);
  file->read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(count * sizeof(T)));
  return numbers;
}

}  // namespace

VisualIndex::VisualIndex(VisualWords words) : words_(std::move(words)), files_(static_cast<size_t>(words_.NumWords())) {
  const Descriptors all_words = words_.Words();
  for (Eigen::Index i = 0; i < all_words.rows(); ++i) projected_words_.push_back(Project(all_words.row(i).data()));
}

VisualIndex VisualIndex::Read(std::ifstream* file) {
  VisualIndex index(VisualWords::Read(file));
  for (InvertedFile& entries : index.files_) {
    const uint64_t count = ReadNumbers<uint64_t>(1, file).front();
    entries.image_ids = ReadNumbers<int32_t>(count, file);
    entries.signatures = ReadNumbers<uint64_t>(count, file);
    for (const int32_t image_id : entries.image_ids) index.CountFeature(image_id);
  }
  return index;
}

void VisualIndex::Write(std::ofstream* file) const {
  words_.Write(file);
  for (const InvertedFile& entries : files_) {
    WriteNumbers<uint64_t>({entries.image_ids.size()}, file);
    WriteNumbers(entries.image_ids, file);
    WriteNumbers(entries.signatures, file);
  }
}

void VisualIndex::Add(int image_id, const Descriptors& descriptors, IdleThreads* idle_threads) {
  LAZYLOC_CHECK(image_id >= static_cast<int>(num_features_.size()));
  const std::vector<int> words = words_.Find(descriptors, idle_threads);
  for (size_t i = 0; i < words.size(); ++i) {
    InvertedFile& file = files_[static_cast<size_t>(words[i])];
    file.image_ids.push_back(image_id);
    file.signatures.push_back(Signature(descriptors.row(static_cast<Eigen::Index>(i)).data(), words[i]));
    CountFeature(image_id);
  }
}

std::vector<std::pair<int, float>> VisualIndex::Query(const Descriptors& descriptors, IdleThreads* idle_threads) const {
  const std::vector<int> words = words_.Find(descriptors, idle_threads);
  std::vector<float> scores(num_features_.size());
  for (size_t i = 0; i < words.size(); ++i) {
    Vote(files_[static_cast<size_t>(words[i])],
         Signature(descriptors.row(static_cast<Eigen::Index>(i)).data(), words[i]), &scores);
  }
  std::vector<std::pair<int, float>> ranked;
  for (size_t id = 0; id < scores.size(); ++id) {
    if (scores[id] == 0) continue;
    ranked.emplace_back(static_cast<int>(id), scores[id] / std::sqrt(static_cast<float>(num_features_[id])));
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  return ranked;
}

void VisualIndex::CountFeature(int image_id) {
  num_features_.resize(std::max(num_features_.size(), static_cast<size_t>(image_id) + 1));
  ++num_features_[static_cast<size_t>(image_id)];
}

// Multiplies by orthogonal vectors of 1 and -1: random signs, then the first half of a Hadamard matrix, whose rows
// repeat themselves and so add the second half of the numbers to the first. No sum exceeds 128 x 255, which fits.
VisualIndex::Projections VisualIndex::Project(const uint8_t* descriptor) {
  static const std::array<int16_t, kDescriptorLength> signs = RandomSigns();
  static_assert(2 * kNumBits == kDescriptorLength);
  Projections sums;
  for (size_t i = 0; i < kNumBits; ++i) {
    sums[i] = static_cast<int16_t>(signs[i] * descriptor[i] + signs[i + kNumBits] * descriptor[i + kNumBits]);
  }
  for (size_t step = 1; step < kNumBits; step *= 2) {
    for (size_t begin = 0; begin < kNumBits; begin += 2 * step) {
      for (size_t i = begin; i < begin + step; ++i) {
        const int first = sums[i], second = sums[i + step];
        sums[i] = static_cast<int16_t>(first + second);
        sums[i + step] = static_cast<int16_t>(first - second);
      }
    }
  }
  return sums;
}

uint64_t VisualIndex::Signature(const uint8_t* descriptor, int word) const {
  const Projections projections = Project(descriptor);
  const Projections& thresholds = projected_words_[static_cast<size_t>(word)];
  uint64_t signature = 0;
  for (size_t i = 0; i < kNumBits; ++i) signature |= static_cast<uint64_t>(projections[i] > thresholds[i]) << i;
  return signature;
}

void VisualIndex::Vote(const InvertedFile& file, uint64_t signature, std::vector<float>* scores) {
  static const std::array<float, kMaxDistance + 1> weights = WeightsOfVotes();
  int32_t image_id = 0;
  float sum = 0;
  int count = 0;
  // Divides the votes for features of one image by the root of their number, because a structure that repeats in an
  // image says less about it.
  const auto add_votes = [&] {
    if (count > 0) (*scores)[static_cast<size_t>(image_id)] += sum / std::sqrt(static_cast<float>(count));
    sum = 0;
    count = 0;
  };
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    for (size_t i = 0; i < file.signatures.size(); ++i) {
      const int distance = __builtin_popcountll(signature ^ file.signatures[i]);
      if (distance > kMaxDistance) continue;
      if (file.image_ids[i] != image_id) add_votes();
      image_id = file.image_ids[i];
      sum += weights[static_cast<size_t>(distance)];
      ++count;
    }
  });
  add_votes();
}

}  // namespace lazyloc
