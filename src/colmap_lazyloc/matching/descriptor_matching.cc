#include "colmap_lazyloc/matching/descriptor_matching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

static_assert(kDescriptorDim == kFeatureType.num_columns);

constexpr float kSquaredLength = 512 * 512;  // of every descriptor
constexpr int kQueryBlock = 256;             // number of query descriptors in a block

// Joins a product and its place in the block to one number: the largest one is the first of the largest products.
constexpr int32_t ToKey(int32_t product, int place) { return product * 256 + (255 - place); }
constexpr int32_t ProductOf(int32_t key) { return key / 256; }
constexpr int PlaceOf(int32_t key) { return 255 - key % 256; }
static_assert(kMaxDescriptorProduct < (1 << 23) && kQueryBlock <= 256 && kDescriptorBlock <= 256, "keys have 31 bits");

// The two largest keys of each row and of each column of a block of products.
struct BlockNeighbours {
  std::array<int32_t, kQueryBlock> query_best, query_second;
  std::array<int32_t, kDescriptorBlock> database_best, database_second;
};

LAZYLOC_ALWAYS_INLINE inline void FindInBlock(const int16_t* query, const int16_t* database, BlockNeighbours* block) {
  block->database_best.fill(0);
  block->database_second.fill(0);
  for (int i = 0; i < kQueryBlock; ++i) {
    const BlockProducts products = MultiplyBlock(query + i * kDescriptorDim, database);
    int32_t best = 0, second = 0;
    for (int j = 0; j < kDescriptorBlock; ++j) {
      best = std::max(best, ToKey(products[j], j));
      const int32_t key = ToKey(products[j], i);
      block->database_second[j] = std::max(block->database_second[j], std::min(block->database_best[j], key));
      block->database_best[j] = std::max(block->database_best[j], key);
    }
    for (int j = 0; j < kDescriptorBlock; ++j) {
      const int32_t key = ToKey(products[j], j);
      second = std::max(second, key == best ? 0 : key);
    }
    block->query_best[i] = best;
    block->query_second[i] = second;
  }
}

// The nearest neighbour of a descriptor in the other image: its index, and the largest and second largest product.
struct Neighbour {
  int index = -1;
  int32_t best = 0, second = 0;

  // Adds the descriptors of the other image's block that begins at `begin`.
  void Add(int32_t best_key, int32_t second_key, Eigen::Index begin) {
    const int32_t product = ProductOf(best_key);
    if (product > best) {
      second = std::max(best, ProductOf(second_key));
      best = product;
      index = static_cast<int>(begin) + PlaceOf(best_key);
    } else {
      second = std::max(second, product);
    }
  }

  // Returns the index if the neighbour is near enough and clearly the nearest, else -1.
  int Match(const SiftMatchingOptions& options) const {
    if (index < 0) return -1;
    const float angle = std::acos(std::min(static_cast<float>(best) / kSquaredLength, 1.0f));
    const float second_angle = std::acos(std::min(static_cast<float>(second) / kSquaredLength, 1.0f));
    const bool is_good = angle <= static_cast<float>(options.max_distance) &&
                         angle < static_cast<float>(options.max_ratio) * second_angle;
    return is_good ? index : -1;
  }
};

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
  LAZYLOC_CHECK(query.cols() == kDescriptorDim && database.cols() == kDescriptorDim);
  const DescriptorRows query_rows = ToBlocks(query, kQueryBlock);
  const DescriptorRows database_rows = ToBlocks(database, kDescriptorBlock);
  std::vector<Neighbour> of_query(query_rows.rows()), of_database(database_rows.rows());
  BlockNeighbours block;
  for (Eigen::Index query_begin = 0; query_begin < query_rows.rows(); query_begin += kQueryBlock) {
    for (Eigen::Index begin = 0; begin < database_rows.rows(); begin += kDescriptorBlock) {
      RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
        FindInBlock(query_rows.row(query_begin).data(), database_rows.row(begin).data(), &block);
      });
      for (int i = 0; i < kQueryBlock; ++i) {
        of_query[query_begin + i].Add(block.query_best[i], block.query_second[i], begin);
      }
      for (int j = 0; j < kDescriptorBlock; ++j) {
        of_database[begin + j].Add(block.database_best[j], block.database_second[j], query_begin);
      }
    }
  }
  for (Eigen::Index i = 0; i < query.rows(); ++i) {
    const int other = of_query[i].Match(options);
    if (other < 0 || (options.cross_check && of_database[other].Match(options) != i)) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(other)});
  }
  return matches;
}

}  // namespace lazyloc
