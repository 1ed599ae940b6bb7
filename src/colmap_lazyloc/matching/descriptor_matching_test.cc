#include "colmap_lazyloc/matching/descriptor_matching.h"

#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Returns for each descriptor of `a` the one of `b` that COLMAP's rules give, or -1, by definition and in whole
// numbers.
std::vector<int> Neighbours(const Descriptors& a, const Descriptors& b, const SiftMatchingOptions& options) {
  std::vector<int> neighbours;
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    int best = 0, second = 0, neighbour = -1;
    for (Eigen::Index j = 0; j < b.rows(); ++j) {
      const int product = a.row(i).cast<int>().dot(b.row(j).cast<int>());
      if (product > best) {
        second = best;
        best = product;
        neighbour = static_cast<int>(j);
      } else {
        second = std::max(second, product);
      }
    }
    const auto angle = [](int product) { return std::acos(std::min(product / (512.0f * 512.0f), 1.0f)); };
    const bool is_good = angle(best) <= static_cast<float>(options.max_distance) &&
                         angle(best) < static_cast<float>(options.max_ratio) * angle(second);
    neighbours.push_back(is_good ? neighbour : -1);
  }
  return neighbours;
}

TEST(MatchDescriptors, FindsTheNeighboursOfNoisyDescriptors) {
  const Descriptors query = RandomDescriptors(300, 1);
  Descriptors database = WithNoise(query, 2).colwise().reverse();
  database.bottomRows(100) = RandomDescriptors(100, 3);  // the neighbours of the first 100 are gone
  const Matches matches = MatchDescriptors(query, database, {});
  EXPECT_EQ(matches.size(), 200u);
  for (const Match& match : matches) EXPECT_EQ(match.other_point, 299 - match.query_point);
}

Matches MatchByDefinition(const Descriptors& query, const Descriptors& database, const SiftMatchingOptions& options) {
  const std::vector<int> of_query = Neighbours(query, database, options);
  const std::vector<int> of_database = Neighbours(database, query, options);
  Matches matches;
  for (uint32_t i = 0; i < of_query.size(); ++i) {
    if (of_query[i] < 0 || (options.cross_check && of_database[of_query[i]] != static_cast<int>(i))) continue;
    matches.push_back({i, static_cast<uint32_t>(of_query[i])});
  }
  return matches;
}

TEST(MatchDescriptors, AgreesWithTheDefinition) {
  const Descriptors query = RandomDescriptors(310, 1);
  Descriptors database(350, 128);
  database << WithNoise(query, 2).topRows(200), WithNoise(query, 3).bottomRows(150);
  for (const double max_ratio : {0.8, 0.95, 1.0}) {
    for (const bool cross_check : {true, false}) {
      SiftMatchingOptions options;
      options.max_ratio = max_ratio;
      options.cross_check = cross_check;
      const Matches expected = MatchByDefinition(query, database, options);
      EXPECT_GT(expected.size(), 100u);
      EXPECT_EQ(MatchDescriptors(query, database, options), expected);
    }
  }
}

TEST(MatchDescriptors, AgreesWithTheDefinitionForAnyNumberOfDescriptors) {
  const Descriptors all = RandomDescriptors(300, 1), other = WithNoise(all, 2);
  for (const int num_query : {1, 4, 5, 255, 260}) {
    for (const int num_database : {1, 2, 63, 64, 65, 129}) {
      const Descriptors query = all.topRows(num_query), database = other.topRows(num_database).colwise().reverse();
      EXPECT_EQ(MatchDescriptors(query, database, {}), MatchByDefinition(query, database, {}));
    }
  }
}

// Few values make many equal products. With a ratio above 1, the first of equal neighbours is the match.
TEST(MatchDescriptors, AgreesWithTheDefinitionIfManyProductsAreEqual) {
  for (const int largest : {0, 1, 255}) {
    Descriptors query = RandomDescriptors(280, 1), database = RandomDescriptors(200, 2);
    for (Descriptors* some : {&query, &database}) {
      const Descriptors large = (some->array() > 20).cast<uint8_t>() * static_cast<uint8_t>(largest);
      *some = large;
      for (Eigen::Index column = 8; column < some->cols(); ++column) some->col(column).setZero();
    }
    for (const bool cross_check : {true, false}) {
      SiftMatchingOptions options;
      options.max_ratio = 1.5;
      options.max_distance = 2;
      options.cross_check = cross_check;
      const Matches expected = MatchByDefinition(query, database, options);
      EXPECT_EQ(MatchDescriptors(query, database, options), expected);
      EXPECT_EQ(expected.empty(), largest == 0);
    }
  }
}

TEST(MatchDescriptors, RatioTestRefusesWhatHasTwoNeighbours) {
  const Descriptors query = RandomDescriptors(50, 1);
  Descriptors database(100, 128);
  database << WithNoise(query, 2), WithNoise(query, 2);
  EXPECT_THAT(MatchDescriptors(query, database, {}), IsEmpty());
}

TEST(MatchDescriptors, DistanceLimitRefusesWhatIsFar) {
  const Descriptors query = RandomDescriptors(50, 1), database = RandomDescriptors(50, 2);
  SiftMatchingOptions options;
  options.max_ratio = 1;
  options.max_distance = 2;
  EXPECT_GT(MatchDescriptors(query, database, options).size(), 10u);
  options.max_distance = 0.3;
  EXPECT_THAT(MatchDescriptors(query, database, options), IsEmpty());
}

TEST(MatchDescriptors, LargestProductsAreExact) {
  const Descriptors query = Descriptors::Constant(1, 128, 255);
  Descriptors database = Descriptors::Constant(70, 128, 1);
  database.row(67).setConstant(255);
  EXPECT_THAT(MatchDescriptors(query, database, {}), ElementsAre(Match{0, 67}));
}

TEST(MatchDescriptors, EmptyImagesHaveNoMatches) {
  const Descriptors some = RandomDescriptors(10, 1), none(0, 128);
  EXPECT_THAT(MatchDescriptors(some, none, {}), IsEmpty());
  EXPECT_THAT(MatchDescriptors(none, some, {}), IsEmpty());
}

}  // namespace
}  // namespace lazyloc
