#include "colmap_lazyloc/group/uncalibrated_camera.h"

#include <cmath>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

Camera PhotoCamera() {
  Camera camera;
  camera.width = 1600;
  camera.height = 1200;
  return camera;
}

// Returns the score of images that suggest these displacements, each by itself, with a standard deviation.
IntrinsicsScore Suggest(double shift_px, double corner_px, double stddev_px) {
  const double radius = HalfDiagonalPx(PhotoCamera());
  IntrinsicsScore::Vector corner_from_correction;
  corner_from_correction << radius, 1, 1, radius, std::pow(radius / kRadialUnitPx, 3),
      std::pow(radius / kRadialUnitPx, 5);
  IntrinsicsScore score;
  score.information = (corner_from_correction / stddev_px).cwiseAbs2().asDiagonal();
  IntrinsicsScore::Vector suggested = IntrinsicsScore::Vector::Zero();
  suggested[PRINCIPAL_POINT_X] = shift_px;
  suggested[RADIAL_DISTORTION] = corner_px / corner_from_correction[RADIAL_DISTORTION];
  score.score = score.information * suggested;
  return score;
}

CorrectionDistribution Correct(const IntrinsicsScore& score, IntrinsicsOrigin origin = IntrinsicsOrigin::GUESS) {
  return UncalibratedCorrections(score, score.information, OtherCorrections::Zero(), PhotoCamera(), origin);
}

TEST(UncalibratedCorrections, ClearOnesAreTaken) {
  const CorrectionDistribution corrections = Correct(Suggest(10, -30, 0.2));
  EXPECT_NEAR(corrections.mean[PRINCIPAL_POINT_X - 1], 10, 0.1);
  EXPECT_NEAR(corrections.mean[RADIAL_DISTORTION - 1], -30, 0.3);  // the corners are kRadialUnitPx from the centre
  EXPECT_NEAR(std::sqrt(corrections.covariance(0, 0)), 0.2, 0.02);
}

TEST(UncalibratedCorrections, DoubtfulOnesAreNot) {
  const CorrectionDistribution corrections = Correct(Suggest(2, 3, 2));
  EXPECT_LT(corrections.mean[PRINCIPAL_POINT_X - 1], 1);
  EXPECT_LT(corrections.mean[RADIAL_DISTORTION - 1], 1);
}

TEST(UncalibratedCorrections, WhatImagesDoNotShowIsUncertainAsUsual) {
  const CorrectionDistribution corrections = Correct(Suggest(0, 0, 1e5));
  // Half of the cameras are off by 2 % of the half diagonal, 1000 px.
  EXPECT_NEAR(std::sqrt(corrections.covariance(0, 0)), 20 / std::sqrt(2), 0.1);
  EXPECT_TRUE(corrections.mean.isZero(1e-3));
}

TEST(UncalibratedCorrections, MeasuredIntrinsicsAreKept) {
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::GIVEN, IntrinsicsOrigin::MODEL}) {
    const CorrectionDistribution corrections = Correct(Suggest(10, -30, 0.2), origin);
    EXPECT_TRUE(corrections.mean.isZero(0));
    EXPECT_TRUE(corrections.covariance.isZero(0));
  }
}

}  // namespace
}  // namespace lazyloc
