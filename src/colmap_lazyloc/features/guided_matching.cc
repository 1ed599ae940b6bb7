#include "colmap_lazyloc/features/guided_matching.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/SVD>

#include "colmap_lazyloc/features/nearest_descriptor.h"
#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr auto kPi = static_cast<float>(M_PI);

// A ray among the epipolar planes, which all hold the baseline: the plane that it lies in has this angle.
struct RayInPencil {
  float angle_rad = 0;  // in [0, pi)
  float x = 0, y = 0;   // part of the ray across the baseline
  size_t place = 0;     // of the feature in its image
};

// Returns the rays sorted by angle. axes: those across the baseline, one a row.
std::vector<RayInPencil> SortByAngle(const Rays& rays, const Eigen::Matrix<double, 2, 3>& axes) {
  std::vector<RayInPencil> sorted;
  sorted.reserve(rays.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector2f across = (axes * rays[i]).cast<float>();
    if (across.isZero(0)) continue;
    const float angle = std::atan2(across.y(), across.x());  // from -pi on
    sorted.push_back({angle < 0 ? angle + kPi : angle, across.x(), across.y(), i});
  }
  std::sort(sorted.begin(), sorted.end(), [](const RayInPencil& a, const RayInPencil& b) {
    return a.angle_rad != b.angle_rad ? a.angle_rad < b.angle_rad : a.place < b.place;
  });
  return sorted;
}

LAZYLOC_ALWAYS_INLINE inline int32_t Product(const int16_t* a, const uint8_t* b) {
  int32_t sum = 0;
  for (int k = 0; k < kDescriptorLength; ++k) sum += a[k] * static_cast<int16_t>(b[k]);
  return sum;
}

}  // namespace

Matches MatchAlongEpipolarLines(const DescriptorsWithRays& query, const DescriptorsWithRays& other,
                                const Eigen::Matrix3d& E, double max_error_rad) {
  // With E = s1 u1 v1^T + s2 u2 v2^T, the constraint says that (u1 x, u2 x) and (-s2 v2 y, s1 v1 y) are parallel.
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(E, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d scales = svd.singularValues() / svd.singularValues()(0);
  Eigen::Matrix<double, 2, 3> other_axes;
  other_axes << -scales(1) * svd.matrixV().col(1).transpose(), svd.matrixV().col(0).transpose();
  const std::vector<RayInPencil> others = SortByAngle(other.rays, other_axes);
  std::vector<NearestDescriptor> of_query(query.rays.size()), of_other(other.rays.size());
  const auto max_error = static_cast<float>(max_error_rad);
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    for (const RayInPencil& ray : SortByAngle(query.rays, svd.matrixU().leftCols<2>().transpose())) {
      const size_t query_place = ray.place;
      int16_t descriptor[kDescriptorLength];
      for (int k = 0; k < kDescriptorLength; ++k) {
        descriptor[k] = query.descriptors(static_cast<Eigen::Index>(query_place), k);
      }
      // Compares the descriptor with those of all rays between two angles that fulfil the constraint.
      const auto compare = [&](float from_rad, float to_rad) LAZYLOC_ALWAYS_INLINE {
        for (auto it = std::lower_bound(others.begin(), others.end(), from_rad,
                                        [](const RayInPencil&a, float angle) { return a.angle_rad < angle; });
             it != others.end() && it->angle_rad <= to_rad; ++it) {
          const float gap = ray.x * it->y - ray.y * it->x;  // x^T E y
          const float squared_sum = ray.x * ray.x + ray.y * ray.y + it->x * it->x + it->y * it->y;
          if (gap * gap > max_error * max_error * squared_sum) continue;  // Sampson's error
          const int32_t product = Product(descriptor, &other.descriptors(static_cast<Eigen::Index>(it->place), 0));
          of_query[query_place].Add(static_cast<int>(it->place), product, 0);
          of_other[it->place].Add(static_cast<int>(query_place), product, 0);
        }
      };
      // Sampson's error is at most this large unless the other ray is much nearer to the baseline.
      const float reach_rad = std::min(2 * max_error / std::hypot(ray.x, ray.y), kPi / 2);
      compare(ray.angle_rad - reach_rad, ray.angle_rad + reach_rad);
      compare(ray.angle_rad - reach_rad + kPi, kPi);
      compare(0, ray.angle_rad + reach_rad - kPi);
    }
  });
  Matches matches;
  for (size_t i = 0; i < of_query.size(); ++i) {
    const int place = of_query[i].Match();
    if (place < 0 || of_other[static_cast<size_t>(place)].Match() != static_cast<int>(i)) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(place)});
  }
  return matches;
}

}  // namespace lazyloc
