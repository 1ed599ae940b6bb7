#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"

#include <cmath>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(JudgeFocalLength, DoubtsWithSignificanceAndSize) {
  const auto given = [](double log_factor, double stddev) {
    return JudgeFocalLength(log_factor, stddev, IntrinsicsOrigin::GIVEN, {});
  };
  EXPECT_LT(given(0, 0.001).wrong_probability, 0.01);
  EXPECT_LT(given(0.005, 0.0001).wrong_probability, 0.05) << "as measured values are off";
  EXPECT_GT(given(0.02, 0.001).wrong_probability, 0.95);
  EXPECT_LT(given(0.02, 0.02).wrong_probability, 0.1) << "not significant";
  EXPECT_GT(given(0.2, 0.02).wrong_probability, 0.99);
  EXPECT_GT(JudgeFocalLength(0.02, 0.01, IntrinsicsOrigin::EXIF, {}).wrong_probability,
            given(0.02, 0.01).wrong_probability);
}

// An estimate from images without noise differs from an exact value only because adjustment is linearised.
TEST(JudgeFocalLength, DoesNotDoubtAnExactValueByTheErrorOfLinearisation) {
  LocalizerOptions options;
  options.focal_length_stddev_ratio = 0;
  EXPECT_LT(JudgeFocalLength(1e-6, 1e-8, IntrinsicsOrigin::GIVEN, options).wrong_probability, 0.01);
}

TEST(JudgeFocalLength, NeverDoubtsThatOfTheModel) {
  const FocalLengthJudgement far = JudgeFocalLength(0.5, 0.001, IntrinsicsOrigin::MODEL, {});
  EXPECT_EQ(far.wrong_probability, 0);
  EXPECT_GT(std::sqrt(far.mean_square), 0.1) << "but allows for what the images suggest";
  EXPECT_NEAR(std::sqrt(JudgeFocalLength(0, 0.1, IntrinsicsOrigin::MODEL, {}).mean_square), 0.014, 0.01);
}

TEST(JudgeFocalLength, MeanSquareIsThatOfTheImagesOrOfTheOrigin) {
  const auto root = [](double log_factor, double stddev, IntrinsicsOrigin origin) {
    return std::sqrt(JudgeFocalLength(log_factor, stddev, origin, {}).mean_square);
  };
  EXPECT_NEAR(root(0, 0.0001, IntrinsicsOrigin::GIVEN), 0.0001, 1e-5) << "confirmed";
  EXPECT_NEAR(root(0.005, 0.0001, IntrinsicsOrigin::GIVEN), 0.005, 5e-4) << "off by so much";
  EXPECT_GT(root(0.02, 0.01, IntrinsicsOrigin::GIVEN), 0.005) << "perhaps slightly wrong";
  EXPECT_LT(root(0, 0.1, IntrinsicsOrigin::GIVEN), 0.05) << "a measured value counts";
  EXPECT_NEAR(root(0, 10, IntrinsicsOrigin::GUESS), 0.2, 0.01) << "nothing is known";
}

}  // namespace
}  // namespace lazyloc
