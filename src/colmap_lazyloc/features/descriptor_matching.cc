#include "colmap_lazyloc/features/descriptor_matching.h"

#include <algorithm>
#include <vector>

#include "colmap_lazyloc/features/lane_neighbours.h"
#include "colmap_lazyloc/features/nearest_descriptor.h"
#include "colmap_lazyloc/math/vectorized.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int kRowsPerChunk = 256;  // rows whose neighbours fit into a cache while all blocks pass

// The neighbours of all descriptors of two images in the other one.
struct AllNeighbours {
  std::vector<LaneNeighbours> of_rows;     // one per row; lanes are columns, places are vectors of columns
  std::vector<LaneNeighbours> of_columns;  // one per vector of columns; lanes are columns, places are rows
};

AllNeighbours FindNeighbours(const DescriptorRows& rows, const DescriptorBlocks& columns) {
  AllNeighbours neighbours;
  neighbours.of_rows.resize(static_cast<size_t>(rows.NumRows()));
  neighbours.of_columns.resize(static_cast<size_t>(columns.NumBlocks()) * kVectorsPerBlock);
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    ProductTile products;
    for (int begin = 0; begin < rows.NumRows(); begin += kRowsPerChunk) {
      const int end = std::min(begin + kRowsPerChunk, rows.NumRows());
      for (int block = 0; block < columns.NumBlocks(); ++block) {
        const int first_vector = block * kVectorsPerBlock;
        for (int row = begin; row < end; row += kDescriptorRows) {
          columns.Multiply(rows, row, block, &products);
          AddTile(products, row, first_vector, &neighbours.of_rows[row], &neighbours.of_columns[first_vector]);
        }
      }
    }
  });
  return neighbours;
}

}  // namespace

Matches MatchDescriptors(const Descriptors& query, const Descriptors& database) {
  Matches matches;
  if (query.rows() == 0 || database.rows() == 0) return matches;
  LAZYLOC_CHECK(query.cols() == kDescriptorLength && database.cols() == kDescriptorLength);
  const AllNeighbours neighbours = FindNeighbours(DescriptorRows(query), DescriptorBlocks(database));
  for (int i = 0; i < query.rows(); ++i) {
    const int other = OfRow(neighbours.of_rows[static_cast<size_t>(i)]).Match();
    if (other < 0 || OfColumn(neighbours.of_columns, other).Match() != i) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(other)});
  }
  return matches;
}

}  // namespace lazyloc
