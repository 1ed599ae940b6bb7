#pragma once

#include <algorithm>
#include <vector>

#include "colmap_lazyloc/features/nearest_descriptor.h"
#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/vectorized.h"

// The nearest neighbours of descriptors, found in tiles of products.
namespace lazyloc {

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

// Returns the neighbour of a row, among columns.
inline NearestDescriptor OfRow(const LaneNeighbours& lanes) {
  NearestDescriptor neighbour;
  for (int lane = 0; lane < kNumLanes; ++lane) {
    neighbour.Add(lanes.place.values[lane] * kNumLanes + lane, lanes.best.values[lane], lanes.second.values[lane]);
  }
  return neighbour;
}

// Returns the neighbour of a column, among rows. of_vectors: one per vector of columns.
inline NearestDescriptor OfColumn(const std::vector<LaneNeighbours>& of_vectors, int column) {
  const LaneNeighbours& lanes = of_vectors[static_cast<size_t>(column / kNumLanes)];
  const int lane = column % kNumLanes;
  NearestDescriptor neighbour;
  neighbour.Add(lanes.place.values[lane], lanes.best.values[lane], lanes.second.values[lane]);
  return neighbour;
}

}  // namespace lazyloc
