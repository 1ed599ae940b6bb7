#include "colmap_lazyloc/features/visual_words.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int kWordsPerCell = kDescriptorBlock;  // on average, because products are computed by block
constexpr int kDescriptorsPerCell = 64;          // that the centre of a cell is learnt from
constexpr int kNumNearestCells = 4;              // nearest cells of a descriptor, whose words it is compared with

using Rows = std::vector<Eigen::Index>;

// Returns the rows in which each cell is.
std::vector<Rows> RowsOfCells(const Eigen::MatrixXi& cells, Eigen::Index num_cells) {
  std::vector<Rows> rows(static_cast<size_t>(num_cells));
  for (Eigen::Index i = 0; i < cells.rows(); ++i) {
    for (Eigen::Index k = 0; k < cells.cols(); ++k) {
      if (cells(i, k) >= 0) rows[static_cast<size_t>(cells(i, k))].push_back(i);
    }
  }
  return rows;
}

// Returns at least `count` rows, or all if there are no more.
Descriptors EvenlySpaced(const Descriptors& descriptors, Eigen::Index count) {
  const Eigen::Index step = std::max<Eigen::Index>(1, descriptors.rows() / count);
  return descriptors(Eigen::seq(0, descriptors.rows() - 1, step), Eigen::all);
}

void WriteDescriptors(const Descriptors& descriptors, std::ofstream* file) {
  const uint64_t num_rows = static_cast<uint64_t>(descriptors.rows());
  file->write(reinterpret_cast<const char*>(&num_rows), sizeof(num_rows));
  file->write(reinterpret_cast<const char*>(descriptors.data()), descriptors.size());
}

Descriptors ReadDescriptors(std::ifstream* file) {
  uint64_t num_rows = 0;
  file->read(reinterpret_cast<char*>(&num_rows), sizeof(num_rows));
  Descriptors descriptors(static_cast<Eigen::Index>(num_rows), kDescriptorLength);
  file->read(reinterpret_cast<char*>(descriptors.data()), descriptors.size());
  return descriptors;
}

}  // namespace

VisualWords VisualWords::Train(const Descriptors& descriptors, int num_words, uint32_t seed,
                               IdleThreads* idle_threads) {
  LAZYLOC_CHECK(descriptors.rows() > 0 && descriptors.cols() == kDescriptorLength);
  const int num_cells = (num_words + kWordsPerCell - 1) / kWordsPerCell;
  Descriptors cells = FindCentres(EvenlySpaced(descriptors, Eigen::Index{num_cells} * kDescriptorsPerCell), num_cells,
                                  seed, idle_threads);
  const std::vector<Rows> rows =
      RowsOfCells(NearestCentres(cells).Find(descriptors, 1, idle_threads).indices, cells.rows());
  std::vector<Descriptors> words(rows.size());
  ParallelFor(
      rows.size(),
      [&](size_t cell) {
        // Gives a cell the share of the words that it has of the descriptors.
        const size_t share =
            static_cast<size_t>(num_words) * rows[cell].size() / static_cast<size_t>(descriptors.rows());
        words[cell] = rows[cell].empty()
                          ? Descriptors(cells.row(static_cast<Eigen::Index>(cell)))
                          : FindCentres(descriptors(rows[cell], Eigen::all), std::max(1, static_cast<int>(share)),
                                        seed + static_cast<uint32_t>(cell), idle_threads);
      },
      idle_threads);
  return {std::move(cells), words};
}

VisualWords VisualWords::Read(std::ifstream* file) {
  Descriptors cells = ReadDescriptors(file);
  std::vector<Descriptors> words;
  for (Eigen::Index i = 0; i < cells.rows(); ++i) words.push_back(ReadDescriptors(file));
  return {std::move(cells), words};
}

VisualWords::VisualWords(Descriptors cells, const std::vector<Descriptors>& words)
    : cells_(std::move(cells)), words_of_cell_(words.begin(), words.end()), first_words_(1, 0) {
  for (const Descriptors& of_cell : words) {
    first_words_.push_back(first_words_.back() + static_cast<int>(of_cell.rows()));
  }
}

void VisualWords::Write(std::ofstream* file) const {
  WriteDescriptors(cells_.Centres(), file);
  for (const NearestCentres& words : words_of_cell_) WriteDescriptors(words.Centres(), file);
}

Descriptors VisualWords::Words() const {
  Descriptors words(NumWords(), kDescriptorLength);
  for (size_t cell = 0; cell < words_of_cell_.size(); ++cell) {
    const Descriptors& of_cell = words_of_cell_[cell].Centres();
    words.middleRows(first_words_[cell], of_cell.rows()) = of_cell;
  }
  return words;
}

std::vector<int> VisualWords::Find(const Descriptors& descriptors, IdleThreads* idle_threads) const {
  const std::vector<Rows> rows =
      RowsOfCells(cells_.Find(descriptors, kNumNearestCells, idle_threads).indices, cells_.Centres().rows());
  std::vector<Neighbours> found(rows.size());
  ParallelFor(
      rows.size(),
      [&](size_t cell) {
        found[cell] = words_of_cell_[cell].Find(descriptors(rows[cell], Eigen::all), 1, idle_threads);
      },
      idle_threads);
  std::vector<int> words(static_cast<size_t>(descriptors.rows()));
  std::vector<int> distances(words.size(), std::numeric_limits<int>::max());
  for (size_t cell = 0; cell < rows.size(); ++cell) {
    for (size_t i = 0; i < rows[cell].size(); ++i) {
      const auto row = static_cast<size_t>(rows[cell][i]);
      const int distance = found[cell].distances(static_cast<Eigen::Index>(i), 0);
      if (distance >= distances[row]) continue;
      distances[row] = distance;
      words[row] = first_words_[cell] + found[cell].indices(static_cast<Eigen::Index>(i), 0);
    }
  }
  return words;
}

}  // namespace lazyloc
