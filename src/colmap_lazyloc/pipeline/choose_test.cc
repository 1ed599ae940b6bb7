#include "colmap_lazyloc/pipeline/choose.h"

#include <memory>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/solutions_test_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Makes up solutions of a single query and chooses among them.
class ChooseTest : public testing::Test {
 protected:
  ChooseTest() { solutions_.reserve(8); }  // so that references stay valid

  Solution& Add(const Hypothesis& hypothesis) { return solutions_.emplace_back(query_.Solved(hypothesis)); }
  Solution& AddGiven(IntrinsicsOrigin origin = IntrinsicsOrigin::GIVEN) {
    Solution& given = Add({});
    given.checked.results[0].origin = origin;
    return given;
  }
  // Adds a solution with an estimated focal length.
  Solution& AddEstimate(IntrinsicsOrigin origin, double factor) {
    Solution& estimate = Add(estimated_);
    estimate.checked.results[0] = {origin, IntrinsicsVerdict::REFINED, factor, 0.001, ""};
    return estimate;
  }

  Choice Chosen() const {
    Choices choices;
    for (const Solution& solution : solutions_) choices.Add(solution);
    return Choose(choices, options_);
  }
  // Returns the index of the solution that is chosen.
  int Index() const { return static_cast<int>(Chosen().solution - solutions_.data()); }
  IntrinsicsResult Intrinsics() const { return Chosen().intrinsics.front(); }

  const Hypothesis estimated_{true};
  const MadeUpQuery query_;
  LocalizerOptions options_;
  std::vector<Solution> solutions_;
};

TEST_F(ChooseTest, WhatIsTriedForAnOpenPositionReplacesIt) {
  AddGiven().failure = Failure{QueryStatus::DEGENERATE_BASELINE, ""};
  Add({false, "", Approach::ROTATION});
  EXPECT_EQ(Index(), 1);
  Add({false, "a.jpg"}).failure = Failure{QueryStatus::SCALE_UNOBSERVABLE, ""};
  EXPECT_EQ(Index(), 2) << "its failure says more";
}

// What comes of the two orientations is tested in plane_orientation_test.cc.
TEST_F(ChooseTest, OrientationWhoseOtherOneFailsIsTheOnlyOneIfMostMatchesHaveTracks) {
  Solution& first = AddGiven();
  const auto choice = [&](size_t num_matches) {
    auto input = std::make_shared<StartInput>();
    input->tracks.rest.resize(num_matches);
    first.input = input;
    return Chosen();
  };
  first.refined.emplace();
  Track track;
  track.observations.emplace_back().image = 0;  // of the query
  first.refined->adjustment.tracks.assign(20, track);
  Add({false, "", Approach::OTHER_ORIENTATION}).failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_EQ(choice(39).solution, &first);
  EXPECT_EQ(choice(39).has_one_orientation, true);
  EXPECT_EQ(choice(40).has_one_orientation, std::nullopt);
}

TEST_F(ChooseTest, PositionByAPriorThatIsNotReconciledLeavesTheFailureOfTheImages) {
  AddGiven().failure = Failure{QueryStatus::SCALE_UNOBSERVABLE, "one image"};
  Solution& by_prior = Add({false, "", Approach::POSITION_PRIOR});
  by_prior.priors[0].position = PriorResult{PriorVerdict::USED, PriorRole::DISTANCE, 1, 1};
  Track track;
  track.observations.emplace_back().image = 0;
  track.point_in_world = {0, 0, 100};
  by_prior.refined.emplace();
  by_prior.refined->adjustment.posed = by_prior.prepared->layout.given;
  by_prior.refined->adjustment.tracks = {track};
  EXPECT_EQ(Index(), 1) << "there is no prior";
  const PositionPrior far_away{{1000, 0, 0}, Eigen::Matrix3d::Identity()};
  by_prior.refined->adjustment.posed.query_priors = {{0, {far_away, std::nullopt}}};
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Chosen().failure->reason, "one image");
  EXPECT_EQ(Chosen().priors[0].position->verdict, PriorVerdict::CONTRADICTED);
  by_prior.refined.reset();
  by_prior.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  by_prior.priors[0].position = PriorResult{};
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Chosen().failure->reason, "one image");
  EXPECT_EQ(Chosen().priors[0].position->verdict, PriorVerdict::NOT_TESTED);
}

TEST_F(ChooseTest, GuessOfAFocalLengthIsTakenOnlyWithAPoseByAMeasuredPosition) {
  Solution& estimate = AddEstimate(IntrinsicsOrigin::GUESS, 1);
  estimate.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_EQ(Index(), 0);
  Solution& guess = AddGiven(IntrinsicsOrigin::GUESS);
  EXPECT_EQ(Index(), 0) << "any focal length has a pose";
  guess.priors[0].position = PriorResult{PriorVerdict::USED, PriorRole::DISTANCE, 1, 1};
  EXPECT_EQ(Index(), 1);
  estimate.failure->cause = QueryStatus::UNKNOWN_CAMERA;
  EXPECT_EQ(Index(), 0) << "the images cannot judge the guess";
  estimate.failure->cause = QueryStatus::TOO_FEW_TRACKS;
  guess.checked.results[0].verdict = IntrinsicsVerdict::CONTRADICTED;
  EXPECT_EQ(Index(), 0);
}

TEST_F(ChooseTest, FocalLengthOfASharedCameraIsReplacedOnlyIfItIsWrong) {
  AddGiven(IntrinsicsOrigin::SHARED);
  Solution& estimate = AddEstimate(IntrinsicsOrigin::SHARED, 1.1);
  EXPECT_EQ(Index(), 1);
  estimate.checked.results[0].focal_factor = 1.0005;
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::CONFIRMED);
  EXPECT_EQ(Intrinsics().focal_factor, 1.0005);
  EXPECT_GT(Chosen().extra_log_focal_variance, 0) << "the estimate is off by half a standard deviation";
  solutions_[0].checked.poses[0].log_focal_variance = 1;
  EXPECT_LT(Chosen().extra_log_focal_variance, 0) << "the covariance contains more already";
  estimate.checked.results[0].focal_factor_stddev = 0.1;
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::UNOBSERVABLE);
  solutions_[0].failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_EQ(Index(), 1) << "the given one has no pose";
}

TEST_F(ChooseTest, FocalLengthOfExifReplacesAnEstimateThatIsLessCredible) {
  Solution& estimate = AddEstimate(IntrinsicsOrigin::EXIF, 1.1);
  Solution& given = AddGiven(IntrinsicsOrigin::EXIF);
  EXPECT_EQ(Index(), 0) << "it is wrong";
  estimate.evidence[0] = query_.Unlikely();
  EXPECT_EQ(Index(), 1);
  given.failure = Failure{QueryStatus::SCALE_UNOBSERVABLE, ""};
  EXPECT_EQ(Index(), 0);
  estimate.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_EQ(Index(), 1) << "its failure says more";
}

TEST_F(ChooseTest, StatedFocalLengthIsContradictedByAnEstimateOnly) {
  Solution& given = AddGiven();
  given.checked.results[0].verdict = IntrinsicsVerdict::CONTRADICTED;
  given.checked.results[0].contradiction = "by its score";
  Solution& estimate = AddEstimate(IntrinsicsOrigin::GIVEN, 1.0005);
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::CONFIRMED);
  EXPECT_EQ(Intrinsics().contradiction, "");
  EXPECT_THAT(FramesWithoutPose(Chosen(), options_), IsEmpty());
  estimate.checked.results[0].focal_factor = 1.1;
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::CONTRADICTED);
  EXPECT_EQ(Intrinsics().focal_factor, 1.1);
  EXPECT_THAT(Intrinsics().contradiction, HasSubstr("focal length of"));
  EXPECT_THAT(FramesWithoutPose(Chosen(), options_), ElementsAre(0));
  estimate.checked.results[0].focal_factor = 1;
  estimate.checked.results[0].contradiction = "distortion";
  EXPECT_EQ(Intrinsics().contradiction, "distortion");
}

TEST_F(ChooseTest, EstimateWithoutPoseIsNoEvidence) {
  Solution& given = AddGiven(IntrinsicsOrigin::SHARED);
  given.checked.results[0].verdict = IntrinsicsVerdict::CONTRADICTED;
  Solution& estimate = AddEstimate(IntrinsicsOrigin::SHARED, 1.1);
  estimate.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::CONTRADICTED);
  estimate.failure->cause = QueryStatus::UNKNOWN_CAMERA;
  given.checked.results[0].focal_factor_stddev = 0.1;
  EXPECT_EQ(Index(), 0);
  EXPECT_EQ(Intrinsics().verdict, IntrinsicsVerdict::UNOBSERVABLE) << "the images tell no focal length";
}

TEST_F(ChooseTest, EstimateThatIsFarLessCredibleIsNoEvidence) {
  Solution& given = AddGiven(IntrinsicsOrigin::SHARED);
  AddEstimate(IntrinsicsOrigin::SHARED, 1.1).evidence[0] = query_.Unlikely();
  EXPECT_EQ(Index(), 0);
  given.checked.results[0].verdict = IntrinsicsVerdict::CONTRADICTED;
  EXPECT_EQ(Index(), 1) << "the given one has no pose";
}

TEST_F(ChooseTest, RunnerUpIsTheOtherOneWithAPose) {
  AddGiven(IntrinsicsOrigin::SHARED);
  EXPECT_EQ(Chosen().runner_up, nullptr);
  Solution& estimate = AddEstimate(IntrinsicsOrigin::SHARED, 1.0005);
  EXPECT_EQ(Chosen().runner_up, &solutions_[1]);
  estimate.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  estimate.evidence.clear();
  EXPECT_EQ(Chosen().runner_up, nullptr);
}

TEST_F(ChooseTest, DoubtInAFocalLength) {
  Solution& given = AddGiven();
  IntrinsicsResult& intrinsics = given.checked.results[0];
  intrinsics.focal_factor_stddev = 0.001;
  EXPECT_FALSE(IsFocalLengthUncertain(Choice(given), options_));
  intrinsics.focal_factor_stddev = 0.02;
  EXPECT_TRUE(IsFocalLengthUncertain(Choice(given), options_)) << "its score tells nothing";
  intrinsics.origin = IntrinsicsOrigin::SHARED;
  EXPECT_FALSE(IsFocalLengthUncertain(Choice(given), options_)) << "it is probably the photo's camera";
  const PoseEvidence likely = std::exchange(given.evidence[0], query_.Unlikely());
  EXPECT_TRUE(IsFocalLengthUncertain(Choice(given), options_)) << "its pose is refused";
  given.evidence[0] = likely;
  intrinsics.origin = IntrinsicsOrigin::GIVEN;
  intrinsics.focal_factor_stddev = 0.001;
  intrinsics.focal_factor = 1.02;
  EXPECT_TRUE(IsFocalLengthUncertain(Choice(given), options_)) << "its score speaks against it";
  intrinsics.focal_factor = 1;
  intrinsics.verdict = IntrinsicsVerdict::CONTRADICTED;
  EXPECT_TRUE(IsFocalLengthUncertain(Choice(given), options_)) << "something else is contradicted";
  given.failure = Failure{QueryStatus::TOO_FEW_TRACKS, ""};
  EXPECT_FALSE(IsFocalLengthUncertain(Choice(given), options_)) << "somebody has stated it";
  intrinsics.origin = IntrinsicsOrigin::SHARED;
  EXPECT_TRUE(IsFocalLengthUncertain(Choice(given), options_));
}

TEST(Better, LaterAttemptIsTakenPerImageAndOnlyIfItAloneLocalizesTheImage) {
  SyntheticGroupOptions synthetic;
  synthetic.num_frames = 5;
  synthetic.num_sensors = 1;
  const MadeUpQuery group(MakeSyntheticGroup(synthetic).group);
  // The first attempt localizes images 0 to 2, the later one 1 to 4.
  const auto attempt = [&](const std::vector<int>& unlikely) {
    auto solution = std::make_shared<Solution>(group.Solved({}));
    for (const int frame : unlikely) solution->evidence[frame] = MadeUpQuery::Unlikely();
    return solution;
  };
  const auto earlier = attempt({3, 4}), later = attempt({0});
  const auto choice = [](const Solution& solution, int query, double seconds) {
    return ImageChoice{std::make_shared<Choice>(solution), query, {{"a", seconds}}};
  };
  std::vector<bool> is_later;
  for (int query = 0; query < 5; ++query) {
    const ImageChoice better = Better(choice(*earlier, query, 1), choice(*later, query, 2), {});
    is_later.push_back(better.choice->solution == later.get());
    EXPECT_EQ(better.query, query);
    EXPECT_EQ(better.seconds.front().second, 3);
  }
  EXPECT_THAT(is_later, ElementsAre(false, false, false, true, true));
  LocalizerOptions lenient;
  lenient.min_confidence = 0;
  EXPECT_EQ(Better(choice(*earlier, 4, 1), choice(*later, 4, 2), lenient).choice->solution, earlier.get());
}

TEST(FramesWithoutPose, AreThoseThatFailOrContradictTheirIntrinsics) {
  SyntheticGroupOptions synthetic;
  synthetic.num_frames = 3;
  const MadeUpQuery group(MakeSyntheticGroup(synthetic).group);
  Solution solution = group.Solved({});
  const auto frames = [&](IntrinsicsMode mode) {
    LocalizerOptions options;
    options.intrinsics = mode;
    return FramesWithoutPose(Choice(solution), options);
  };
  EXPECT_THAT(frames(IntrinsicsMode::AUTO), IsEmpty());
  solution.checked.results[3].verdict = IntrinsicsVerdict::CONTRADICTED;  // of the second frame
  EXPECT_THAT(frames(IntrinsicsMode::AUTO), ElementsAre(1));
  EXPECT_THAT(frames(IntrinsicsMode::GIVEN), IsEmpty());
  solution.failure = Failure{QueryStatus::TOO_FEW_TRACKS, "", {0, 2}};
  EXPECT_THAT(frames(IntrinsicsMode::AUTO), ElementsAre(0, 2));
  solution.failure->frames.clear();
  EXPECT_THAT(frames(IntrinsicsMode::AUTO), ElementsAre(0, 1, 2));
}

}  // namespace
}  // namespace lazyloc
