#include "colmap_lazyloc/features/descriptor_matching.h"

#include <algorithm>
#include <vector>

#include "colmap_lazyloc/features/nearest_descriptor.h"
#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/vectorized.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int kRowsPerChunk = 256;  // rows whose neighbours fit into a cache while all blocks pass
constexpr int kVectorsPerBlock = kDescriptorBlock / kNumLanes;

// Largest and second largest product so far in each lane, and the place where the largest one was first.
struct LaneNeighbours {
  Lanes best = {}, second = {}, place = {};

  LAZYLOC_ALWAYS_INLINE inline void Add(const Lanes& products, int new_place) {
    for (int lane = 0; lane < kNumLanes; ++lane) {
      const int32_t product = products.values[lane], old = best.values[lane];
      second.values[lane] = std::max(second.values[lane], std::min(old, product));
      place.values[lane] = product > old ? new_place : place.values[lane];
      best.values[lane] = std::max(old, product);
    }
  }
};

// Adds a tile of products. of_rows, of_columns: neighbours of the tile's rows and columns.
LAZYLOC_ALWAYS_INLINE inline void AddTile(const ProductTile& products, int first_row, int first_vector,
                                          LaneNeighbours* of_rows, LaneNeighbours* of_columns) {
  for (int i = 0; i < kDescriptorRows; ++i) {
    LaneNeighbours of_row = of_rows[i];
    for (int v = 0; v < kVectorsPerBlock; ++v) of_row.Add(products.rows[i][v], first_vector + v);
    of_rows[i] = of_row;
  }
  for (int v = 0; v < kVectorsPerBlock; ++v) {
    LaneNeighbours of_column = of_columns[v];
    for (int i = 0; i < kDescriptorRows; ++i) of_column.Add(products.rows[i][v], first_row + i);
    of_columns[v] = of_column;
  }
}

// The neighbours of all descriptors of two images in the other one.
struct AllNeighbours {
  std::vector<LaneNeighbours> of_rows;     // one per row; lanes are columns, places are vectors of columns
  std::vector<LaneNeighbours> of_columns;  // one per vector of columns; lanes are columns, places are rows

  NearestDescriptor OfRow(int row) const {
    const LaneNeighbours& lanes = of_rows[static_cast<size_t>(row)];
    NearestDescriptor neighbour;
    for (int lane = 0; lane < kNumLanes; ++lane) {
      neighbour.Add(lanes.place.values[lane] * kNumLanes + lane, lanes.best.values[lane], lanes.second.values[lane]);
    }
    return neighbour;
  }

  NearestDescriptor OfColumn(int column) const {
    const LaneNeighbours& lanes = of_columns[static_cast<size_t>(column / kNumLanes)];
    const int lane = column % kNumLanes;
    NearestDescriptor neighbour;
    neighbour.Add(lanes.place.values[lane], lanes.best.values[lane], lanes.second.values[lane]);
    return neighbour;
  }
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
    const int other = neighbours.OfRow(i).Match();
    if (other < 0 || neighbours.OfColumn(other).Match() != i) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(other)});
  }
  return matches;
}

}  // namespace lazyloc
