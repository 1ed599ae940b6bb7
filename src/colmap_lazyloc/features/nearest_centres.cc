#include "colmap_lazyloc/features/nearest_centres.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>
#include <utility>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr int32_t kFar = std::numeric_limits<int32_t>::max();
constexpr int kNumIterations = 5;  // of Lloyd's; more do not make retrieval better

// Nearest centres of one descriptor among the centres added so far.
struct Nearest {
  explicit Nearest(size_t count) : centres(count, {kFar, -1}) {}

  // Add centres in order of their index: among centres at the same distance, the first is kept.
  void Add(int32_t distance, int index) {
    if (distance >= centres.back().first) return;
    centres.back() = {distance, index};
    for (size_t i = centres.size() - 1; i > 0 && centres[i] < centres[i - 1]; --i)
      std::swap(centres[i], centres[i - 1]);
  }

  std::vector<std::pair<int32_t, int>> centres;  // distance, index
};

using Distances = std::array<int32_t, kDescriptorBlock>;

// Sets the distances to the centres of a block. Returns the smallest.
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

// Returns rows drawn without replacement, in their order. Uses the generator's own numbers, because distributions
// differ between standard libraries.
Descriptors DrawRows(const Descriptors& descriptors, Eigen::Index count, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<Eigen::Index> rows(static_cast<size_t>(descriptors.rows()));
  std::iota(rows.begin(), rows.end(), 0);
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) std::swap(rows[i], rows[i + random() % (rows.size() - i)]);
  rows.resize(static_cast<size_t>(count));
  std::sort(rows.begin(), rows.end());
  return descriptors(rows, Eigen::all);
}

// Moves each centre to the mean of its descriptors. A centre without any stays.
void MoveCentres(const Descriptors& descriptors, const Eigen::MatrixXi& nearest, Descriptors* centres) {
  Eigen::Matrix<uint32_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> sums(centres->rows(), centres->cols());
  sums.setZero();
  std::vector<uint32_t> counts(static_cast<size_t>(centres->rows()));
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    sums.row(nearest(i, 0)) += descriptors.row(i).cast<uint32_t>();
    ++counts[static_cast<size_t>(nearest(i, 0))];
  }
  for (Eigen::Index k = 0; k < centres->rows(); ++k) {
    const uint32_t count = counts[static_cast<size_t>(k)];
    if (count == 0) continue;
    centres->row(k) =
        sums.row(k).unaryExpr([&](uint32_t sum) { return static_cast<uint8_t>((sum + count / 2) / count); });
  }
}

}  // namespace

NearestCentres::NearestCentres(Descriptors centres)
    : centres_(std::move(centres)),
      blocks_(centres_),
      // Fills up the last block, whose padding is never nearest.
      squared_norms_(static_cast<size_t>(blocks_.NumBlocks() * kDescriptorBlock), kFar) {
  for (Eigen::Index i = 0; i < centres_.rows(); ++i) {
    squared_norms_[static_cast<size_t>(i)] = centres_.row(i).cast<int32_t>().squaredNorm();
  }
}

Neighbours NearestCentres::Find(const Descriptors& descriptors, int num_neighbours, IdleThreads* idle_threads) const {
  Neighbours found = {Eigen::MatrixXi(descriptors.rows(), num_neighbours),
                      Eigen::MatrixXi(descriptors.rows(), num_neighbours)};
  ParallelForRanges(
      static_cast<size_t>(descriptors.rows()),
      [&](size_t begin, size_t end) {
        FindOnOneThread(descriptors.middleRows(begin, end - begin), static_cast<Eigen::Index>(begin), &found);
      },
      idle_threads);
  return found;
}

void NearestCentres::FindOnOneThread(const Descriptors& descriptors, Eigen::Index first_row, Neighbours* found) const {
  const DescriptorRows rows(descriptors);
  std::vector<Nearest> nearest(static_cast<size_t>(rows.NumRows()),
                               Nearest(static_cast<size_t>(found->indices.cols())));
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    ProductTile products;
    Distances distances;
    for (int block = 0; block < blocks_.NumBlocks(); ++block) {
      const int begin = block * kDescriptorBlock;
      for (int row = 0; row < rows.NumRows(); ++row) {
        const int place = row % kDescriptorRows;
        if (place == 0) blocks_.Multiply(rows, row, block, &products);
        const int32_t smallest = FindDistances(products.rows[place], &squared_norms_[begin], &distances);
        if (smallest >= nearest[row].centres.back().first) continue;
        for (int j = 0; j < kDescriptorBlock; ++j) nearest[row].Add(distances[j], begin + j);
      }
    }
  });
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    for (Eigen::Index k = 0; k < found->indices.cols(); ++k) {
      std::tie(found->distances(first_row + i, k), found->indices(first_row + i, k)) = nearest[i].centres[k];
    }
  }
}

Descriptors FindCentres(const Descriptors& descriptors, int num_clusters, uint32_t seed, IdleThreads* idle_threads) {
  Descriptors centres = DrawRows(descriptors, std::min<Eigen::Index>(num_clusters, descriptors.rows()), seed);
  if (centres.rows() == descriptors.rows()) return centres;
  for (int i = 0; i < kNumIterations; ++i) {
    MoveCentres(descriptors, NearestCentres(centres).Find(descriptors, 1, idle_threads).indices, &centres);
  }
  return centres;
}

}  // namespace lazyloc
