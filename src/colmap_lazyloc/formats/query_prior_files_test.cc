#include "colmap_lazyloc/formats/query_prior_files.h"

#include <set>

#include <gmock/gmock.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

class QueryPriorFiles : public IoTest {
 protected:
  std::map<std::string, QueryPrior> Read(const std::string& positions, const std::string& gravity = "") {
    QueryPriorOptions options;
    if (!positions.empty()) options.position_path = WriteFile("positions.txt", positions);
    if (!gravity.empty()) options.gravity_path = WriteFile("gravity.txt", gravity);
    options.world_up = "0,0,2";
    const std::set<std::string> queries = {"a.jpg", "b c.jpg", "7", "7 8 9"};
    return ReadQueryPriors(options, [&](const std::string& name) { return queries.count(name) > 0; });
  }
  void ExpectPositionError(const std::string& content, const std::string& message) {
    EXPECT_EQ(ErrorOf([&] { Read(content); }), "positions.txt" + message);
  }
  void ExpectGravityError(const std::string& content, const std::string& message) {
    EXPECT_EQ(ErrorOf([&] { Read("", content); }), "gravity.txt" + message);
  }
};

TEST_F(QueryPriorFiles, PositionsHaveOneThreeOrSixNumbersOfUncertainty) {
  const auto priors = Read("# comment\na.jpg 1 2 3 0.5\nb c.jpg 4 5 6 1 2 3\n7 1 2 3 4 0.1 0.2 5 0.3 6\n");
  ASSERT_EQ(priors.size(), 3);
  EXPECT_EQ(priors.at("a.jpg").position->position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(priors.at("a.jpg").position->covariance, 0.25 * Eigen::Matrix3d::Identity());
  EXPECT_FALSE(priors.at("a.jpg").gravity);
  EXPECT_EQ(priors.at("b c.jpg").position->covariance, Eigen::Matrix3d(Eigen::Vector3d(1, 4, 9).asDiagonal()));
  Eigen::Matrix3d covariance;
  covariance << 4, 0.1, 0.2, 0.1, 5, 0.3, 0.2, 0.3, 6;
  EXPECT_EQ(priors.at("7").position->covariance, covariance);
}

TEST_F(QueryPriorFiles, NamesMayHoldNumbers) {
  const auto priors = Read("7 8 9 1 2 3 0.5\n");
  ASSERT_EQ(priors.count("7 8 9"), 1) << "not 7 with three deviations";
  EXPECT_EQ(priors.at("7 8 9").position->position, Eigen::Vector3d(1, 2, 3));
}

TEST_F(QueryPriorFiles, GravityIsAUnitVectorDown) {
  const auto priors = Read("", "a.jpg 0 9.81 0 1\n");
  const GravityPrior& gravity = *priors.at("a.jpg").gravity;
  EXPECT_EQ(gravity.down_in_cam, Eigen::Vector3d::UnitY());
  EXPECT_EQ(gravity.down_in_world, -Eigen::Vector3d::UnitZ());
  EXPECT_NEAR(gravity.stddev_rad, DegToRad(1), 1e-15);
}

TEST_F(QueryPriorFiles, MistakesAreNamedWithTheirLine) {
  const std::string form = "expected `name x y z` and one or three standard deviations, or six numbers of a covariance";
  ExpectPositionError("a.jpg 1 2 3\n", ":1: " + form);
  ExpectPositionError("\na.jpg 1 2\n", ":2: " + form);
  ExpectPositionError("a.jpg 1 2 x 1\n", ":1: 'x' is not a number");
  ExpectPositionError("a.jpg 1 2 nan 1\n", ":1: a number is not finite");
  ExpectPositionError("a.jpg 1 2 3 0\n", ":1: a standard deviation is not positive");
  ExpectPositionError("a.jpg 1 2 3 1 -1 1\n", ":1: a standard deviation is not positive");
  ExpectPositionError("a.jpg 1 2 3 1 2 0 1 0 1\n", ":1: the covariance is not positive definite");
  ExpectPositionError("a.jpg 1 2 3 -1 0 0 1 0 1\n", ":1: the covariance is not positive definite");
  ExpectPositionError("a.jpg 1 2 3 1\na.jpg 1 2 3 1\n", ":2: query 'a.jpg' is listed twice");
  ExpectPositionError("d.jpg 1 2 3 1\n", ":1: 'd.jpg' is not the name of a query; " + form);
  ExpectPositionError("# nothing\n", ": contains no query");
  ExpectGravityError("a.jpg 0 0 0 1\n", ":1: the direction of gravity is zero");
  ExpectGravityError("a.jpg 0 1 0 -1\n", ":1: the standard deviation is not positive");
  ExpectGravityError("a.jpg 0 1 0\n", ":1: expected `name gx gy gz stddev_deg`");
  ExpectGravityError("a.jpg 0 1 inf 1\n", ":1: a number is not finite");
}

TEST(QueryPriorOptions, GravityNeedsADirectionOfTheWorld) {
  QueryPriorOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.gravity_path = "gravity.txt";
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::StartsWith("query_gravity_path needs --LazyLocalizer.world_up"));
  for (const char* text : {"0,0", "0,0,0", "0,0,x", "0,0,1,2", "up", "0,nan,1"}) {
    options.world_up = text;
    EXPECT_FALSE(options.Check(&error)) << text;
    EXPECT_THAT(error, testing::StartsWith("world_up must be a direction x,y,z"));
  }
  options.world_up = "0,-1,0";
  EXPECT_TRUE(options.Check(&error));
}

}  // namespace
}  // namespace lazyloc
