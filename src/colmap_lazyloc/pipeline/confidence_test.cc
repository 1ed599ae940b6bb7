#include "colmap_lazyloc/pipeline/confidence.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/confidence_weights.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

PoseEvidence Typical() {
  PoseEvidence evidence;
  for (const ConfidenceTerm& term : kConfidenceTerms) evidence.*term.evidence = term.typical;
  evidence.scene_distance = 5;
  return evidence;
}

TEST(Confidence, IsHighForTypicalEvidence) { EXPECT_GT(Confidence(Typical()), 0.95); }

TEST(Confidence, FallsWithEachTermThatWorsens) {
  for (const ConfidenceTerm& term : kConfidenceTerms) {
    if (term.weight == 0) continue;
    PoseEvidence worse = Typical(), worst = Typical();
    worse.*term.evidence = term.weight > 0 ? (term.min + term.typical) / 2 : (term.max + term.typical) / 2;
    worst.*term.evidence = term.weight > 0 ? term.min : term.max;
    EXPECT_LT(Confidence(worse), Confidence(Typical()));
    EXPECT_LT(Confidence(worst), Confidence(worse));
    EXPECT_GT(Confidence(worst), 0);
  }
}

TEST(Confidence, DoesNotChangeBeyondTheRangeOfTheFit) {
  for (const ConfidenceTerm& term : kConfidenceTerms) {
    PoseEvidence at_bound = Typical(), beyond = Typical();
    at_bound.*term.evidence = term.max;
    beyond.*term.evidence = 10 * term.max;
    EXPECT_EQ(Confidence(beyond), Confidence(at_bound));
  }
}

TEST(Confidence, RivalWithAsManyMatchesLeavesAnEvenChance) {
  PoseEvidence evidence = Typical();
  evidence.rival_ratio = 0.5;
  EXPECT_NEAR(Confidence(evidence), 0.5, 0.01);
  evidence.rival_ratio = 1.0 / 3;
  EXPECT_NEAR(Confidence(evidence), 8.0 / 9, 0.02) << "twice as many matches make the odds eight to one";
  evidence.rival_ratio = 1;
  EXPECT_LT(Confidence(evidence), 1e-3);
  EXPECT_THAT(LowConfidenceReason(evidence, 0, 0.5), HasSubstr("100 % are for another one"));
}

TEST(Confidence, UnknownEvidenceIsTypical) {
  PoseEvidence unknown = Typical();
  unknown.mean_error_px = unknown.mean_track_length = std::numeric_limits<double>::quiet_NaN();
  unknown.rotation_stddev_deg = unknown.rotation_position_ratio = std::numeric_limits<double>::quiet_NaN();
  unknown.agreeing_ratio = unknown.rival_ratio = unknown.focal_stddev_ratio = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Confidence(unknown), Confidence(Typical()));
}

TEST(Confidence, IsZeroWithoutAFiniteStandardDeviation) {
  PoseEvidence evidence = Typical();
  evidence.position_stddev_ratio = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Confidence(evidence), 0);
}

// Returns the reason of a pose with one value that is not typical.
std::string ReasonOf(double PoseEvidence::*weak_evidence, double value) {
  PoseEvidence evidence = Typical();
  evidence.*weak_evidence = value;
  return LowConfidenceReason(evidence, 0.25, 0.5);
}

TEST(LowConfidenceReason, NamesBothProbabilitiesAndTheWeakestEvidence) {
  const std::string reason = ReasonOf(&PoseEvidence::explained_ratio, 0.1);
  EXPECT_THAT(reason, HasSubstr("only 0.25"));
  EXPECT_THAT(reason, HasSubstr("0.50 is needed"));
  EXPECT_THAT(reason, HasSubstr("explains only 10 % of the verified matches"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::num_common_tracks, 3), HasSubstr("only 3 points"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::focal_stddev_ratio, 0.05), HasSubstr("the focal length only within 5.0 %"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::mean_error_px, 9), HasSubstr("the mean reprojection error is 9.0 px"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::mean_track_length, 2), HasSubstr("only 2.0 images"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::rotation_stddev_deg, 0.75),
              HasSubstr("the rotation's standard deviation is 0.75"));
  EXPECT_THAT(ReasonOf(&PoseEvidence::rotation_position_ratio, 0.1), HasSubstr("10 times as uncertain"));
}

}  // namespace
}  // namespace lazyloc
