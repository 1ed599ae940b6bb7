#include "colmap_lazyloc/features/guided_matching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/SVD>

#include "colmap_lazyloc/features/lane_neighbours.h"
#include "colmap_lazyloc/features/nearest_descriptor.h"
#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr auto kPi = static_cast<float>(M_PI);

// The rays of an image among the epipolar planes, which all hold the baseline, sorted by plane. Whole blocks of
// descriptors: the last ones may have no ray, and zeros as their descriptors.
struct Pencil {
  std::vector<size_t> places;    // of the features in their image
  std::vector<float> angle_rad;  // of the plane that a ray lies in, in [0, pi]
  std::vector<float> x, y;       // part of a ray across the baseline
  Descriptors descriptors;
};

// axes: those across the baseline, one a row.
Pencil SortByAngle(const DescriptorsWithRays& features, const Eigen::Matrix<double, 2, 3>& axes) {
  struct Ray {
    float angle_rad, x, y;
    size_t place;
  };
  std::vector<Ray> rays;
  rays.reserve(features.rays.size());
  for (size_t i = 0; i < features.rays.size(); ++i) {
    const Eigen::Vector2f across = (axes * features.rays[i]).cast<float>();
    if (across.isZero(0)) continue;
    const float angle = std::atan2(across.y(), across.x());  // from -pi on
    rays.push_back({angle < 0 ? angle + kPi : angle, across.x(), across.y(), i});
  }
  std::sort(rays.begin(), rays.end(), [](const Ray& a, const Ray& b) {
    return a.angle_rad != b.angle_rad ? a.angle_rad < b.angle_rad : a.place < b.place;
  });
  Pencil pencil;
  const size_t padded_size = (rays.size() + kDescriptorBlock - 1) / kDescriptorBlock * kDescriptorBlock;
  pencil.descriptors.resize(static_cast<Eigen::Index>(padded_size), kDescriptorLength);
  pencil.descriptors.bottomRows(static_cast<Eigen::Index>(padded_size - rays.size())).setZero();
  for (const Ray& ray : rays) {
    pencil.descriptors.row(static_cast<Eigen::Index>(pencil.places.size())) =
        features.descriptors.row(static_cast<Eigen::Index>(ray.place));
    pencil.places.push_back(ray.place);
    pencil.angle_rad.push_back(ray.angle_rad);
    pencil.x.push_back(ray.x);
    pencil.y.push_back(ray.y);
  }
  pencil.angle_rad.resize(padded_size, kPi);
  pencil.x.resize(padded_size);
  pencil.y.resize(padded_size);
  return pencil;
}

// Rays that may be near the epipolar line of another one, or of one of several: those of a range of angles, which begin
// again after pi.
struct Range {
  float from_rad, to_rad;  // from -pi / 2 to 3 pi / 2

  LAZYLOC_ALWAYS_INLINE bool Has(float angle_rad) const {
    return ((angle_rad >= from_rad) & (angle_rad <= to_rad)) | (angle_rad >= from_rad + kPi) |
           (angle_rad <= to_rad - kPi);
  }
  // Returns the first block and the one after the last of each of the three parts, in their order.
  std::array<std::pair<int, int>, 3> Blocks(const std::vector<float>& sorted_rad) const {
    const auto blocks = [&](float from, float to) -> std::pair<int, int> {
      const auto begin = std::lower_bound(sorted_rad.begin(), sorted_rad.end(), from) - sorted_rad.begin();
      const auto end = std::upper_bound(sorted_rad.begin(), sorted_rad.end(), to) - sorted_rad.begin();
      if (begin >= end) return {0, 0};
      return {static_cast<int>(begin / kDescriptorBlock), static_cast<int>((end - 1) / kDescriptorBlock) + 1};
    };
    return {blocks(0, to_rad - kPi), blocks(from_rad, to_rad), blocks(from_rad + kPi, kPi)};
  }
};

// Compares the rays of a query with those of another image.
class LineMatcher {
 public:
  LineMatcher(const Pencil& query, const Pencil& other, float max_error_rad)
      : query_(query),
        other_(other),
        rows_(query.descriptors),
        columns_(other.descriptors),
        max_error_rad_(max_error_rad),
        of_columns_(other.angle_rad.size() / kNumLanes) {}

  // Calls add_row with each row and its neighbour.
  template <typename AddRow>
  LAZYLOC_ALWAYS_INLINE void Run(const AddRow& add_row) {
    for (int first = 0; first < rows_.NumRows(); first += kDescriptorRows) {
      for (int i = 0; i < kDescriptorRows; ++i) ranges_[i] = RangeOf(first + i);
      Range all = ranges_[0];
      for (const Range& range : ranges_) {
        all = {std::min(all.from_rad, range.from_rad), std::max(all.to_rad, range.to_rad)};
      }
      LaneNeighbours of_rows[kDescriptorRows];
      int next = 0;
      for (const auto& [begin, end] : all.Blocks(other_.angle_rad)) {
        for (int block = std::max(begin, next); block < end; ++block) AddBlock(first, block, of_rows);
        next = std::max(next, end);
      }
      for (int i = 0; i < kDescriptorRows; ++i) add_row(first + i, OfRow(of_rows[i]));
    }
  }

  const std::vector<LaneNeighbours>& OfColumns() const { return of_columns_; }

 private:
  // Sampson's error is at most this large unless the other ray is much nearer to the baseline.
  Range RangeOf(int row) const {
    const auto place = static_cast<size_t>(row);
    const float reach_rad = std::min(2 * max_error_rad_ / std::hypot(query_.x[place], query_.y[place]), kPi / 2);
    return {query_.angle_rad[place] - reach_rad, query_.angle_rad[place] + reach_rad};
  }

  LAZYLOC_ALWAYS_INLINE void AddBlock(int first_row, int block, LaneNeighbours* of_rows) {
    ProductTile products;
    columns_.Multiply(rows_, first_row, block, &products);
    const int first_column = block * kDescriptorBlock, first_vector = block * kVectorsPerBlock;
    for (int i = 0; i < kDescriptorRows; ++i) {
      const float x = query_.x[static_cast<size_t>(first_row + i)], y = query_.y[static_cast<size_t>(first_row + i)];
      for (int v = 0; v < kVectorsPerBlock; ++v) {
        const size_t column = static_cast<size_t>(first_column + v * kNumLanes);
        SetFarToZero(x, y, ranges_[i], &other_.angle_rad[column], &other_.x[column], &other_.y[column],
                     &products.rows[i][v]);
      }
    }
    AddTile(products, first_row, first_vector, of_rows, &of_columns_[static_cast<size_t>(first_vector)]);
  }

  // Sets products with rays that do not fulfil the constraint to 0, which is nobody's neighbour.
  LAZYLOC_ALWAYS_INLINE void SetFarToZero(float x, float y, const Range& range, const float* angle_rad,
                                          const float* other_x, const float* other_y, Lanes* products) const {
    for (int lane = 0; lane < kNumLanes; ++lane) {
      const float gap = x * other_y[lane] - y * other_x[lane];  // x^T E y
      const float squared_sum = x * x + y * y + other_x[lane] * other_x[lane] + other_y[lane] * other_y[lane];
      const bool is_near = gap * gap <= max_error_rad_ * max_error_rad_ * squared_sum;  // Sampson's error
      products->values[lane] = is_near & range.Has(angle_rad[lane]) ? products->values[lane] : 0;
    }
  }

  const Pencil& query_;
  const Pencil& other_;
  const DescriptorRows rows_;
  const DescriptorBlocks columns_;
  const float max_error_rad_;
  Range ranges_[kDescriptorRows] = {};
  std::vector<LaneNeighbours> of_columns_;
};

}  // namespace

Matches MatchAlongEpipolarLines(const DescriptorsWithRays& query, const DescriptorsWithRays& other,
                                const Eigen::Matrix3d& E, double max_error_rad) {
  // With E = s1 u1 v1^T + s2 u2 v2^T, the constraint says that (u1 x, u2 x) and (-s2 v2 y, s1 v1 y) are parallel.
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(E, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d scales = svd.singularValues() / svd.singularValues()(0);
  Eigen::Matrix<double, 2, 3> other_axes;
  other_axes << -scales(1) * svd.matrixV().col(1).transpose(), svd.matrixV().col(0).transpose();
  const Pencil queries = SortByAngle(query, svd.matrixU().leftCols<2>().transpose());
  const Pencil others = SortByAngle(other, other_axes);
  std::vector<int> match_of_query(queries.angle_rad.size());
  LineMatcher matcher(queries, others, static_cast<float>(max_error_rad));
  RunVectorizedIntegers([&]() LAZYLOC_ALWAYS_INLINE {
    matcher.Run([&](int row, const NearestDescriptor& neighbour) {
      match_of_query[static_cast<size_t>(row)] = neighbour.Match();
    });
  });
  Matches matches;
  for (size_t i = 0; i < queries.places.size(); ++i) {
    const int match = match_of_query[i];
    if (match < 0 || OfColumn(matcher.OfColumns(), match).Match() != static_cast<int>(i)) continue;
    matches.push_back(
        {static_cast<uint32_t>(queries.places[i]), static_cast<uint32_t>(others.places[static_cast<size_t>(match)])});
  }
  std::sort(matches.begin(), matches.end(),
            [](const Match& a, const Match& b) { return a.query_point < b.query_point; });
  return matches;
}

}  // namespace lazyloc
