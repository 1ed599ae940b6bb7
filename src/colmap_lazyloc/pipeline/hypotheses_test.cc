#include "colmap_lazyloc/pipeline/hypotheses.h"

#include <vector>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/choose.h"
#include "colmap_lazyloc/pipeline/solutions_test_input.h"

namespace lazyloc {
namespace {

std::optional<Hypothesis> NextAfter(const QueryGroup& group, const std::vector<Solution>& solutions,
                                    const LocalizerOptions& options) {
  Choices choices;
  for (const Solution& solution : solutions) choices.Add(solution);
  return NextHypothesis(group, choices, options);
}

// Returns the next hypothesis after made-up solutions; expects one.
Hypothesis Next(const MadeUpQuery& query, const std::vector<Solution>& solutions,
                const LocalizerOptions& options = {}) {
  const std::optional<Hypothesis> next = NextAfter(query.Group(), solutions, options);
  EXPECT_TRUE(next);
  return next.value_or(Hypothesis());
}

Solution Failed(const MadeUpQuery& query, const Hypothesis& hypothesis, const Failure& failure) {
  Solution solution = query.Solved(hypothesis);
  solution.failure = failure;
  return solution;
}

// Returns a failure whose partial pose has a bearing from a database image.
Failure FailureWithBearing(QueryStatus cause, const std::string& database_name) {
  Failure failure{cause, ""};
  failure.partial_poses[0].bearing = Bearing{database_name, Eigen::Vector3d::UnitX(), 0.01};
  return failure;
}

TEST(NextHypothesis, OrdinaryQueryHasOne) {
  const MadeUpQuery query;
  const Hypothesis first = Next(query, {});
  EXPECT_FALSE(first.estimates_focal_length);
  EXPECT_EQ(first.approach, Approach::TRACKS);
  EXPECT_FALSE(NextAfter(query.Group(), {query.Solved(first)}, {}));
}

TEST(NextHypothesis, ByThePapersMethodThereIsOne) {
  const MadeUpQuery query;
  LocalizerOptions options;
  options.method = Method::PAPER;
  options.intrinsics = IntrinsicsMode::REFINE;
  const Hypothesis first = Next(query, {}, options);
  EXPECT_EQ(first.approach, Approach::PAPER);
  EXPECT_FALSE(first.estimates_focal_length);
  const Solution failed = Failed(query, first, {QueryStatus::SCALE_UNOBSERVABLE, ""});
  EXPECT_FALSE(NextAfter(query.Group(), {failed}, options));
}

TEST(NextHypothesis, FocalLengthOfAnotherCameraIsEstimatedBeforeItIsTried) {
  MadeUpQuery query;
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::GUESS, IntrinsicsOrigin::EXIF, IntrinsicsOrigin::SIMILAR}) {
    query.Problem().intrinsics_origin = origin;
    LocalizerOptions options;
    const Hypothesis first = Next(query, {}, options);
    EXPECT_TRUE(first.estimates_focal_length);
    Solution estimate = query.Solved(first);
    EXPECT_FALSE(NextAfter(query.Group(), {estimate}, options));
    estimate.evidence[0] = query.Unlikely();
    EXPECT_FALSE(Next(query, {estimate}, options).estimates_focal_length);
    std::vector<Solution> solutions = {Failed(query, first, {QueryStatus::UNKNOWN_CAMERA, ""})};
    const Hypothesis stated = Next(query, solutions, options);
    EXPECT_FALSE(stated.estimates_focal_length);
    options.intrinsics = IntrinsicsMode::REFINE;
    EXPECT_FALSE(NextAfter(query.Group(), solutions, options)) << "the focal length must be estimated";
    options.intrinsics = IntrinsicsMode::AUTO;
    solutions.push_back(Failed(query, stated, {QueryStatus::TOO_FEW_TRACKS, ""}));
    EXPECT_FALSE(NextAfter(query.Group(), solutions, options));
    solutions.back() = query.Solved(stated);
    solutions.back().checked.results[0].focal_factor = 1.1;
    EXPECT_FALSE(NextAfter(query.Group(), solutions, options)) << "it has been estimated";
  }
}

TEST(NextHypothesis, OtherOrientationThatMayBeThereIsTried) {
  const MadeUpQuery query;
  Solution first = Failed(query, {}, {QueryStatus::SCALE_UNOBSERVABLE, ""});
  first.refined.emplace();
  first.input = std::make_shared<StartInput>();
  first.other_orientation.emplace();
  const Hypothesis other = Next(query, {first});
  EXPECT_EQ(other.approach, Approach::OTHER_ORIENTATION);
  EXPECT_FALSE(NextAfter(query.Group(), {first, Failed(query, other, {QueryStatus::TOO_FEW_TRACKS, ""})}, {}));
}

TEST(NextHypothesis, PositionOfAPriorIsTriedOnceWhereTheImagesLeaveItOpen) {
  MadeUpQuery query;
  Solution first = Failed(query, {}, {QueryStatus::SCALE_UNOBSERVABLE, ""});
  first.refined.emplace();
  EXPECT_FALSE(NextAfter(query.Group(), {first}, {})) << "there is no prior";
  query.Problem().prior.position.emplace();
  EXPECT_EQ(Next(query, {first}).approach, Approach::POSITION_PRIOR);
  const Solution by_prior = Failed(query, {false, "", Approach::POSITION_PRIOR}, {QueryStatus::TOO_FEW_TRACKS, ""});
  EXPECT_FALSE(NextAfter(query.Group(), {first, by_prior}, {}));
  first.refined.reset();
  EXPECT_FALSE(NextAfter(query.Group(), {first}, {})) << "nothing was adjusted";
}

TEST(NextHypothesis, OneImageOfAPlaceIsTriedIfAPriorMayGiveTheDistance) {
  MadeUpQuery query;
  const Failure failure = FailureWithBearing(QueryStatus::SCALE_UNOBSERVABLE, "database0001.jpg");
  EXPECT_FALSE(NextAfter(query.Group(), {Failed(query, {}, failure)}, {})) << "there is no prior";
  query.Problem().prior.position.emplace();
  const Hypothesis one_image = Next(query, {Failed(query, {}, failure)});
  EXPECT_EQ(one_image.approach, Approach::TRACKS);
  EXPECT_EQ(one_image.only_database_image, "database0001.jpg");
}

TEST(NextHypothesis, RotationIsTriedIfAPriorIsAllThatIsKnownOfThePosition) {
  MadeUpQuery query;
  Failure failure{QueryStatus::DEGENERATE_BASELINE, ""};
  failure.partial_poses[0] = {};
  EXPECT_FALSE(NextAfter(query.Group(), {Failed(query, {}, failure)}, {})) << "there is no prior";
  query.Problem().prior.position.emplace();
  EXPECT_EQ(Next(query, {Failed(query, {}, failure)}).approach, Approach::ROTATION);
  const Failure with_bearing = FailureWithBearing(QueryStatus::DEGENERATE_BASELINE, "database0001.jpg");
  EXPECT_FALSE(NextAfter(query.Group(), {Failed(query, {}, with_bearing)}, {}));
}

TEST(NextHypothesis, FocalLengthInDoubtIsEstimatedUnlessItIsKept) {
  MadeUpQuery query;
  Solution given = query.Solved({});
  given.checked.results[0].focal_factor = 1.1;
  LocalizerOptions options;
  EXPECT_TRUE(Next(query, {given}, options).estimates_focal_length);
  options.intrinsics = IntrinsicsMode::GIVEN;
  EXPECT_FALSE(NextAfter(query.Group(), {given}, options));
  options.intrinsics = IntrinsicsMode::AUTO;
  query.Problem().intrinsics_origin = IntrinsicsOrigin::MODEL;
  EXPECT_FALSE(NextAfter(query.Group(), {given}, options)) << "the database has the same camera";
}

TEST(NextHypothesis, GroupIsSolvedAsStated) {
  const MadeUpQuery group(MakeSyntheticGroup({}).group);
  LocalizerOptions options;
  options.intrinsics = IntrinsicsMode::REFINE;
  const Hypothesis first = Next(group, {}, options);
  EXPECT_FALSE(first.estimates_focal_length);
  const Solution failed = Failed(group, first, {QueryStatus::SCALE_UNOBSERVABLE, ""});
  EXPECT_FALSE(NextAfter(group.Group(), {failed}, options));
}

}  // namespace
}  // namespace lazyloc
