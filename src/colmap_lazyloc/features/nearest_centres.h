#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// The nearest centres of descriptors: a row for each descriptor, with the nearest one in column 0. Among centres at the
// same distance, the first is nearer.
struct Neighbours {
  Eigen::MatrixXi indices;    // of the centres; -1 if there are no more
  Eigen::MatrixXi distances;  // squared, minus the squared norm of the descriptor, which does not change the order
};

// Finds the nearest of some centres of clusters of descriptors, exactly.
class NearestCentres {
 public:
  explicit NearestCentres(Descriptors centres);

  const Descriptors& Centres() const { return centres_; }
  // Uses idle threads, too. Thread-safe.
  Neighbours Find(const Descriptors& descriptors, int num_neighbours, IdleThreads* idle_threads) const;

 private:
  void FindOnOneThread(const Descriptors& descriptors, Eigen::Index first_row, Neighbours* found) const;

  Descriptors centres_;
  DescriptorBlocks blocks_;
  std::vector<int32_t> squared_norms_;  // one entry per centre in blocks_
};

// Clusters descriptors by Lloyd's iterations, which begin with some of them. Returns min(num_clusters, number of
// descriptors) centres. The same input gives the same centres.
Descriptors FindCentres(const Descriptors& descriptors, int num_clusters, uint32_t seed, IdleThreads* idle_threads);

}  // namespace lazyloc
