#include "colmap_lazyloc/uncertainty/confidence.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/group/localizer_options.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Returns evidence of an ordinary right pose.
PoseEvidence Good() {
  PoseEvidence evidence;
  evidence.num_common_tracks = 200;
  evidence.explained_ratio = 0.8;
  evidence.median_error_px = 0.4;
  evidence.position_stddev_ratio = 0.002;
  evidence.scene_distance = 5;
  return evidence;
}

PoseEvidence With(double PoseEvidence::*field, double value) {
  PoseEvidence evidence = Good();
  evidence.*field = value;
  return evidence;
}

TEST(Confidence, IsHighForAnOrdinaryPose) {
  EXPECT_GT(Confidence(Good()), 0.99);
  EXPECT_LT(Confidence(Good()), 1);
}

TEST(Confidence, FallsWithEachObservableThatWorsens) {
  using Field = double PoseEvidence::*;
  struct Case {
    Field field;
    double worse, worst;
  };
  for (const auto& [field, worse, worst] :
       {Case{&PoseEvidence::num_common_tracks, 10, 2}, Case{&PoseEvidence::explained_ratio, 0.4, 0.1},
        Case{&PoseEvidence::median_error_px, 1.5, 4}}) {
    EXPECT_LT(Confidence(With(field, worse)), Confidence(Good()));
    EXPECT_LT(Confidence(With(field, worst)), Confidence(With(field, worse)));
    EXPECT_GT(Confidence(With(field, worst)), 0);
  }
}

TEST(Confidence, TwiceTheRatioOfUnexplainedMatchesMakesTheOddsFourTimesAsLarge) {
  const auto odds = [](double explained_ratio) {
    PoseEvidence evidence = Good();
    evidence.num_common_tracks = 1e9;
    evidence.median_error_px = 1;
    evidence.explained_ratio = explained_ratio;
    return 1 / Confidence(evidence) - 1;
  };
  EXPECT_NEAR(odds(1.0 / 3) / odds(0.5), 4, 0.02);
  EXPECT_NEAR(odds(0.2) / odds(1.0 / 3), 4, 0.02);
}

TEST(Confidence, OddsOfACompetingPoseAreTheThirdPowerOfTheRatioOfScores) {
  EXPECT_EQ(OddsOfCompetingPose(Good()), 0);
  const double equal = OddsOfCompetingPose(With(&PoseEvidence::competing_ratio, 1));
  EXPECT_NEAR(OddsOfCompetingPose(With(&PoseEvidence::competing_ratio, 2)), 8 * equal, 1e-12);
  PoseEvidence half = With(&PoseEvidence::competing_ratio, 1);
  half.explained_ratio = 0.5;
  EXPECT_LT(Confidence(half), LocalizerOptions().min_confidence) << "two places that look exactly alike";
  half.competing_ratio = 0.2;
  EXPECT_GT(Confidence(half), LocalizerOptions().min_confidence);
  EXPECT_THAT(LowConfidenceReason(With(&PoseEvidence::competing_ratio, 1.5), 0.4, 0.9),
              HasSubstr("150 % of its score"));
}

TEST(Confidence, PointsOfSingleImagesCountLess) {
  const PoseEvidence few = With(&PoseEvidence::num_common_tracks, 5);
  PoseEvidence with_single = few;
  with_single.num_single_tracks = 50;
  EXPECT_GT(Confidence(with_single), Confidence(few));
  EXPECT_EQ(Confidence(with_single), Confidence(With(&PoseEvidence::num_common_tracks, 10)));
}

TEST(Confidence, NeedsNoVerifiedMatch) {
  EXPECT_GT(Confidence(With(&PoseEvidence::explained_ratio, kUnknown)), 0.99) << "a pose by depths";
}

TEST(Confidence, IsFiniteWithoutAnyEvidence) {
  PoseEvidence none;
  none.explained_ratio = 0;
  EXPECT_GE(Confidence(none), 0);
  EXPECT_LT(Confidence(none), 0.2);
}

TEST(Confidence, IsZeroWithoutAFiniteStandardDeviation) {
  EXPECT_EQ(Confidence(With(&PoseEvidence::position_stddev_ratio, kUnknown)), 0);
}

TEST(LowConfidenceReason, NamesBothProbabilitiesAndTheStrongerDoubt) {
  const std::string few_matches = LowConfidenceReason(With(&PoseEvidence::explained_ratio, 0.1), 0.25, 0.5);
  EXPECT_THAT(few_matches, HasSubstr("only 0.25"));
  EXPECT_THAT(few_matches, HasSubstr("0.50 is needed"));
  EXPECT_THAT(few_matches, HasSubstr("explains only 10 % of the verified matches, within 0.4 px"));
  EXPECT_THAT(LowConfidenceReason(With(&PoseEvidence::num_common_tracks, 3), 0.25, 0.5), HasSubstr("only 3 points"));
}

}  // namespace
}  // namespace lazyloc
