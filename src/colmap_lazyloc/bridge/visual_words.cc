#include "colmap_lazyloc/bridge/visual_words.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace lazyloc {
namespace {

constexpr Eigen::Index kDescriptorsPerTask = 256;
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

// Sets the squared distances to the words of a block, minus the squared norm of the descriptor, which does not change
// the order. Returns the smallest.
LAZYLOC_ALWAYS_INLINE inline int32_t FindDistances(const int16_t* descriptor, const int16_t* block,
                                                   const int32_t* squared_norms, BlockProducts* distances) {
  const BlockProducts products = MultiplyBlock(descriptor, block);
  int32_t smallest = kFar;
  for (int j = 0; j < kDescriptorBlock; ++j) {
    (*distances)[j] = squared_norms[j] - 2 * products[j];
    smallest = std::min(smallest, (*distances)[j]);
  }
  return smallest;
}

}  // namespace

VisualWords::VisualWords(Descriptors words)
    : words_(std::move(words)),
      blocks_(ToBlocks(words_, kDescriptorBlock)),
      squared_norms_(blocks_.cast<int>().rowwise().squaredNorm()) {
  squared_norms_.tail(blocks_.rows() - words_.rows()) = kFar;  // padding of the last block is never nearest
}

Eigen::MatrixXi VisualWords::Find(const Descriptors& descriptors, int num_neighbors, IdleThreads* idle_threads) const {
  Eigen::MatrixXi ids(descriptors.rows(), std::min<int>(num_neighbors, words_.rows()));
  const Eigen::Index num_tasks = (descriptors.rows() + kDescriptorsPerTask - 1) / kDescriptorsPerTask;
  ParallelFor(
      num_tasks,
      [&](size_t task) {
        const Eigen::Index begin = static_cast<Eigen::Index>(task) * kDescriptorsPerTask;
        const Eigen::Index size = std::min(kDescriptorsPerTask, descriptors.rows() - begin);
        FindOnOneThread(ToBlocks(descriptors.middleRows(begin, size), 1), ids.middleRows(begin, size));
      },
      idle_threads);
  return ids;
}

void VisualWords::FindOnOneThread(const DescriptorRows& descriptors, Eigen::Ref<Eigen::MatrixXi> ids) const {
  std::vector<NearestWords> nearest(descriptors.rows(), NearestWords(static_cast<size_t>(ids.cols())));
  for (Eigen::Index begin = 0; begin < blocks_.rows(); begin += kDescriptorBlock) {
    RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
      BlockProducts distances;
      for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
        const int32_t smallest =
            FindDistances(descriptors.row(i).data(), blocks_.row(begin).data(), &squared_norms_[begin], &distances);
        if (smallest >= nearest[i].words.back().first) continue;
        for (int j = 0; j < kDescriptorBlock; ++j) nearest[i].Add(distances[j], static_cast<int>(begin) + j);
      }
    });
  }
  for (Eigen::Index i = 0; i < ids.rows(); ++i) {
    for (Eigen::Index k = 0; k < ids.cols(); ++k) ids(i, k) = nearest[i].words[k].second;
  }
}

}  // namespace lazyloc
