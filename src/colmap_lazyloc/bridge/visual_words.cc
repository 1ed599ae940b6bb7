#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr int32_t kFar = std::numeric_limits<int32_t>::max();

// Nearest words of one descriptor among the words added so far.
struct NearestWords {
  explicit NearestWords(size_t count) : words(count, {kFar, -1}) {}

  // Add words in order of their index: among words at the same distance, the first is kept.
  void Add(int32_t distance, int index) {
    if (distance >= words.back().first) return;
    words.back() = {distance, index};
    for (size_t i = words.size() - 1; i > 0 && words[i] < words[i - 1]; --i) std::swap(words[i], words[i - 1]);
  }

  std::vector<std::pair<int32_t, int>> words;  // distance, index
};

using Distances = std::array<int32_t, kDescriptorBlock>;

// Sets the squared distances to the words of a block, minus the squared norm of the descriptor, which does not change
// the order. Returns the smallest.
LAZYLOC_ALWAYS_INLINE inline int32_t FindDistances(const Lanes* products, const int32_t* squared_norms,
                                                   Distances* distances) {
  std::memcpy(distances->data(), products, sizeof(*distances));
  int32_t smallest = kFar;
  for (int j = 0; j < kDescriptorBlock; ++j) {
    (*distances)[j] = squared_norms[j] - 2 * (*distances)[j];
    smallest = std::min(smallest, (*distances)[j]);
  }
  return smallest;
}

}  // namespace

VisualWords::VisualWords(Descriptors words)
    : words_(std::move(words)),
      blocks_(words_),
      // Fills up the last block, whose padding is never nearest.
      squared_norms_(static_cast<size_t>(blocks_.NumBlocks() * kDescriptorBlock), kFar) {
  for (Eigen::Index i = 0; i < words_.rows(); ++i) {
    squared_norms_[static_cast<size_t>(i)] = words_.row(i).cast<int32_t>().squaredNorm();
  }
}

Eigen::MatrixXi VisualWords::Find(const Descriptors& descriptors, int num_neighbors, IdleThreads* idle_threads) const {
  Eigen::MatrixXi ids(descriptors.rows(), std::min<int>(num_neighbors, words_.rows()));
  ParallelForRanges(
      static_cast<size_t>(descriptors.rows()),
      [&](size_t begin, size_t end) {
        FindOnOneThread(descriptors.middleRows(begin, end - begin), ids.middleRows(begin, end - begin));
      },
      idle_threads);
  return ids;
}

void VisualWords::FindOnOneThread(const Descriptors& descriptors, Eigen::Ref<Eigen::MatrixXi> ids) const {
  const DescriptorRows rows(descriptors);
  std::vector<NearestWords> nearest(static_cast<size_t>(rows.NumRows()), NearestWords(static_cast<size_t>(ids.cols())));
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    ProductTile products;
    Distances distances;
    for (int block = 0; block < blocks_.NumBlocks(); ++block) {
      const int begin = block * kDescriptorBlock;
      for (int row = 0; row < rows.NumRows(); ++row) {
        const int place = row % kDescriptorRows;
        if (place == 0) blocks_.Multiply(rows, row, block, &products);
        const int32_t smallest = FindDistances(products.rows[place], &squared_norms_[begin], &distances);
        if (smallest >= nearest[row].words.back().first) continue;
        for (int j = 0; j < kDescriptorBlock; ++j) nearest[row].Add(distances[j], begin + j);
      }
    }
  });
  for (Eigen::Index i = 0; i < ids.rows(); ++i) {
    for (Eigen::Index k = 0; k < ids.cols(); ++k) ids(i, k) = nearest[i].words[k].second;
  }
}

}  // namespace lazyloc
