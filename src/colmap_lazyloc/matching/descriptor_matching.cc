#include "colmap_lazyloc/matching/descriptor_matching.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

constexpr int kDim = 128;
// Of a descriptor. Scalar products are whole numbers below 2^24: single precision holds them exactly.
constexpr float kSquaredLength = 512 * 512;
constexpr Eigen::Index kBlockSize = 128;  // query descriptors at a time

// The nearest neighbours of each descriptor of one image: largest and second largest scalar product.
struct Neighbours {
  explicit Neighbours(Eigen::Index size)
      : index(Eigen::ArrayXi::Constant(size, -1)), best(Eigen::ArrayXf::Zero(size)), second(best) {}

  // The neighbour of a descriptor where it is near enough and clearly the nearest, else -1.
  int Partner(Eigen::Index descriptor, const SiftMatchingOptions& options) const {
    if (index[descriptor] < 0) return -1;
    const float angle = std::acos(std::min(best[descriptor] / kSquaredLength, 1.0f));
    const float second_angle = std::acos(std::min(second[descriptor] / kSquaredLength, 1.0f));
    const bool is_good = angle <= static_cast<float>(options.max_distance) &&
                         angle < static_cast<float>(options.max_ratio) * second_angle;
    return is_good ? index[descriptor] : -1;
  }

  Eigen::ArrayXi index;
  Eigen::ArrayXf best, second;
};

// Takes in the products of one query descriptor with all database descriptors, which are changed.
void AddProducts(int query_point, Eigen::Ref<Eigen::ArrayXf> products, Neighbours* of_query, Neighbours* of_database) {
  of_database->second = of_database->second.max(of_database->best.min(products));
  of_database->index = (products > of_database->best).select(query_point, of_database->index);
  of_database->best = of_database->best.max(products);
  Eigen::Index nearest = 0;
  of_query->best[query_point] = products.maxCoeff(&nearest);
  of_query->index[query_point] = static_cast<int>(nearest);
  products[nearest] = 0;
  of_query->second[query_point] = products.maxCoeff();
}

}  // namespace

bool SiftMatchingOptions::Check(std::string* error) const {
  OPTION_GT(max_ratio, 0);
  OPTION_LE(max_ratio, 1);
  OPTION_GT(max_distance, 0);
  return true;
}

Matches MatchDescriptors(const Descriptors& query, const Descriptors& database, const SiftMatchingOptions& options) {
  Matches matches;
  if (query.rows() == 0 || database.rows() == 0) return matches;
  LAZYLOC_CHECK(query.cols() == kDim && database.cols() == kDim);
  const Eigen::MatrixXf database_rows = database.cast<float>();
  Neighbours of_query(query.rows()), of_database(database.rows());
  Eigen::MatrixXf products;  // a column per query descriptor
  for (Eigen::Index begin = 0; begin < query.rows(); begin += kBlockSize) {
    const Eigen::Index size = std::min(kBlockSize, query.rows() - begin);
    products.noalias() = database_rows * query.middleRows(begin, size).transpose().cast<float>();
    for (Eigen::Index i = 0; i < size; ++i) {
      AddProducts(static_cast<int>(begin + i), products.col(i).array(), &of_query, &of_database);
    }
  }
  for (Eigen::Index i = 0; i < query.rows(); ++i) {
    const int partner = of_query.Partner(i, options);
    if (partner < 0 || (options.cross_check && of_database.Partner(partner, options) != i)) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(partner)});
  }
  return matches;
}

}  // namespace lazyloc
