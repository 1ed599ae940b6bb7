#include "colmap_lazyloc/features/descriptor_matching.h"

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
std::vector<int> Neighbours(const Descriptors& a, const Descriptors& b) {
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
    const bool is_good = angle(best) <= 0.7f && angle(best) < 0.8f * angle(second);
    neighbours.push_back(is_good ? neighbour : -1);
  }
  return neighbours;
}

TEST(MatchDescriptors, FindsTheNeighboursOfNoisyDescriptors) {
  const Descriptors query = RandomDescriptors(300, 1);
  Descriptors database = WithNoise(query, 2).colwise().reverse();
  database.bottomRows(100) = RandomDescriptors(100, 3);  // the neighbours of the first 100 are gone
  const Matches matches = MatchDescriptors(query, database);
  EXPECT_EQ(matches.size(), 200u);
  for (const Match& match : matches) EXPECT_EQ(match.other_point, 299 - match.query_point);
}

Matches MatchByDefinition(const Descriptors& query, const Descriptors& database) {
  const std::vector<int> of_query = Neighbours(query, database);
  const std::vector<int> of_database = Neighbours(database, query);
  Matches matches;
  for (uint32_t i = 0; i < of_query.size(); ++i) {
    if (of_query[i] < 0 || of_database[of_query[i]] != static_cast<int>(i)) continue;
    matches.push_back({i, static_cast<uint32_t>(of_query[i])});
  }
  return matches;
}

TEST(MatchDescriptors, AgreesWithTheDefinition) {
  const Descriptors query = RandomDescriptors(310, 1);
  Descriptors database(350, 128);
  database << WithNoise(query, 2).topRows(200), WithNoise(query, 3).bottomRows(150);
  const Matches expected = MatchByDefinition(query, database);
  EXPECT_GT(expected.size(), 100u);
  EXPECT_EQ(MatchDescriptors(query, database), expected);
}

TEST(MatchDescriptors, AgreesWithTheDefinitionForAnyNumberOfDescriptors) {
  const Descriptors all = RandomDescriptors(300, 1), other = WithNoise(all, 2);
  for (const int num_query : {1, 4, 5, 255, 260}) {
    for (const int num_database : {1, 2, 63, 64, 65, 129}) {
      const Descriptors query = all.topRows(num_query), database = other.topRows(num_database).colwise().reverse();
      EXPECT_EQ(MatchDescriptors(query, database), MatchByDefinition(query, database));
    }
  }
}

// Few values make many equal products, which leave few matches.
TEST(MatchDescriptors, AgreesWithTheDefinitionIfManyProductsAreEqual) {
  for (const int largest : {0, 1, 255}) {
    Descriptors query = RandomDescriptors(280, 1), database = RandomDescriptors(200, 2);
    for (Descriptors* some : {&query, &database}) {
      const Descriptors large = (some->array() > 20).cast<uint8_t>() * static_cast<uint8_t>(largest);
      *some = large;
      for (Eigen::Index column = 8; column < some->cols(); ++column) some->col(column).setZero();
    }
    EXPECT_EQ(MatchDescriptors(query, database), MatchByDefinition(query, database));
  }
}

TEST(MatchDescriptors, RatioTestRefusesWhatHasTwoNeighbours) {
  const Descriptors query = RandomDescriptors(50, 1);
  Descriptors database(100, 128);
  database << WithNoise(query, 2), WithNoise(query, 2);
  EXPECT_THAT(MatchDescriptors(query, database), IsEmpty());
}

TEST(MatchDescriptors, DistanceLimitRefusesWhatIsFar) {
  Descriptors query = Descriptors::Zero(1, 128), database = query;
  query.leftCols(64).setConstant(64);                                            // of unit length
  for (const auto& [num_common, num_matches] : {std::pair{50, 1u}, {48, 0u}}) {  // angles of 0.67 and 0.72 rad
    database.setZero();
    database.middleCols(64 - num_common, 64).setConstant(64);
    EXPECT_EQ(MatchDescriptors(query, database).size(), num_matches);
  }
}

TEST(MatchDescriptors, LargestProductsAreExact) {
  const Descriptors query = Descriptors::Constant(1, 128, 255);
  Descriptors database = Descriptors::Constant(70, 128, 1);
  database.row(67).setConstant(255);
  EXPECT_THAT(MatchDescriptors(query, database), ElementsAre(Match{0, 67}));
}

TEST(MatchDescriptors, EmptyImagesHaveNoMatches) {
  const Descriptors some = RandomDescriptors(10, 1), none(0, 128);
  EXPECT_THAT(MatchDescriptors(some, none), IsEmpty());
  EXPECT_THAT(MatchDescriptors(none, some), IsEmpty());
}

}  // namespace
}  // namespace lazyloc
