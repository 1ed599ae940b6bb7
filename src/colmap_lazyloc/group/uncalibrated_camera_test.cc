#include "colmap_lazyloc/group/uncalibrated_camera.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"

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
  return UncalibratedCorrections(score, 1, OtherCorrections::Zero(), PhotoCamera(), origin);
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

TEST(JointCorrections, ManyImagesAreAsCertainAsTheSumOfTheirInformation) {
  const IntrinsicsScore score = Suggest(10, -30, 2);
  const IntrinsicsInformation one = InformationOf(score, 1);
  IntrinsicsInformation sum;
  for (int i = 0; i < 25; ++i) {
    sum.precision += one.precision;
    sum.gradient += one.gradient;
  }
  const IntrinsicsDistribution joint = JointCorrections(sum, PhotoCamera(), IntrinsicsOrigin::GUESS);
  EXPECT_NEAR(joint.mean[PRINCIPAL_POINT_X], 10, 0.1);
  EXPECT_NEAR(joint.mean[RADIAL_DISTORTION], -30, 0.3);
  EXPECT_NEAR(std::sqrt(joint.covariance(PRINCIPAL_POINT_X, PRINCIPAL_POINT_X)), 2.0 / 5, 0.01);
  EXPECT_NEAR(std::sqrt(joint.covariance(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR)), 2.0 / 5 / 1000, 1e-6);
}

TEST(JointCorrections, CamerasWithoutDistortionGetNone) {
  const IntrinsicsScore score = Suggest(0.3, 0.5, 1);
  const IntrinsicsDistribution joint =
      JointCorrections(InformationOf(score, 1), PhotoCamera(), IntrinsicsOrigin::GUESS);
  EXPECT_LT(std::abs(joint.mean[RADIAL_DISTORTION]), 0.3);
  EXPECT_LT(std::abs(joint.mean[PRINCIPAL_POINT_X]), 0.2);
}

TEST(Corrected, IsUndoneByCorrectionsBetween) {
  const Camera given = AsOpenCv(CameraFromFocalLength(*CameraModelId("RADIAL"), 1200, 1600, 1200));
  IntrinsicsCorrections corrections;
  corrections << 0.2, 5, -7, 0.002, -12, 4;
  const Camera corrected = Corrected(given, corrections);
  EXPECT_NEAR(std::sqrt(corrected.params[0] * corrected.params[1]), 1200 * std::exp(0.2), 1e-9);
  EXPECT_NEAR(corrected.params[1] / corrected.params[0], std::exp(0.002), 1e-12);
  EXPECT_TRUE(CorrectionsBetween(given, corrected).isApprox(corrections, 1e-5));
}

}  // namespace
}  // namespace lazyloc
