#include "colmap_lazyloc/features/mutual_neighbours.h"

#include <cstring>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Lower than for matches (0.85), because at night hardly any features are that similar.
constexpr float kMinCosine = 0.7f;

Eigen::MatrixXf DescriptorColumns(const Features& features) {
  const Eigen::Index length = features.descriptors.cols() / static_cast<Eigen::Index>(sizeof(float));
  Eigen::MatrixXf columns(length, features.descriptors.rows());
  std::memcpy(columns.data(), features.descriptors.data(), static_cast<size_t>(features.descriptors.size()));
  return columns;
}

}  // namespace

size_t CountMutualNeighbours(const Features& features, const Features& others) {
  if (features.keypoints.empty() || others.keypoints.empty()) return 0;
  LAZYLOC_CHECK(features.descriptors.cols() == others.descriptors.cols());
  const Eigen::MatrixXf cosines = DescriptorColumns(features).transpose() * DescriptorColumns(others);
  size_t count = 0;
  for (Eigen::Index i = 0; i < cosines.cols(); ++i) {
    Eigen::Index nearest = 0, back = 0;
    if (cosines.col(i).maxCoeff(&nearest) < kMinCosine) continue;
    cosines.row(nearest).maxCoeff(&back);
    count += back == i;
  }
  return count;
}

}  // namespace lazyloc
