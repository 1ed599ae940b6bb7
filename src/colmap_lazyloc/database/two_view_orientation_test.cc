#include "colmap_lazyloc/database/two_view_orientation.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

Rigid3d RandomPose(std::mt19937* random) {
  std::normal_distribution<double> normal;
  const auto next = [&] { return normal(*random); };
  const Eigen::Quaterniond rotation(next(), next(), next(), next());
  return {rotation.normalized(), {next(), next(), next()}};
}

bool IsSame(const Rigid3d& a, const Rigid3d& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

TEST(CanonicalRelativePose, KeepsRotationAndDirection) {
  std::mt19937 random(1);
  for (int i = 0; i < 100; ++i) {
    const Rigid3d pose = RandomPose(&random);
    const Rigid3d canonical = CanonicalRelativePose(pose);
    EXPECT_GE(canonical.rotation.w(), 0);
    EXPECT_LE(canonical.rotation.angularDistance(pose.rotation), 3e-10);
    EXPECT_LE((canonical.translation - pose.translation.normalized()).norm(), 3e-10);
    EXPECT_NEAR(canonical.translation.norm(), 1, 3e-10);
  }
}

TEST(CanonicalRelativePose, SignAndScaleDoNotMatter) {
  std::mt19937 random(2);
  for (int i = 0; i < 100; ++i) {
    const Rigid3d pose = RandomPose(&random);
    const Rigid3d other = {Eigen::Quaterniond(-2 * pose.rotation.coeffs()), 1024 * pose.translation};
    EXPECT_TRUE(IsSame(CanonicalRelativePose(pose), CanonicalRelativePose(other)));
  }
}

TEST(CanonicalRelativePose, HalfTurnHasOneSign) {
  const Rigid3d pose = {Eigen::Quaterniond(1e-17, -0.6, 0.8, 0), Eigen::Vector3d::UnitX()};
  const Rigid3d other = {Eigen::Quaterniond(1e-17, 0.6, -0.8, -0.0), Eigen::Vector3d::UnitX()};
  EXPECT_TRUE(IsSame(CanonicalRelativePose(pose), CanonicalRelativePose(other)));
  EXPECT_GT(CanonicalRelativePose(pose).rotation.x(), 0);
}

TEST(CanonicalRelativePose, HasNoNegativeZeros) {
  const Rigid3d pose = CanonicalRelativePose({Eigen::Quaterniond(-1, 0, -0.0, 1e-20), {-0.0, -1e-20, 3}});
  EXPECT_FALSE(std::signbit(pose.rotation.x()) || std::signbit(pose.rotation.y()) || std::signbit(pose.rotation.z()));
  EXPECT_FALSE(std::signbit(pose.translation.x()) || std::signbit(pose.translation.y()));
}

TEST(CanonicalRelativePose, ZeroTranslationStaysZero) {
  const Rigid3d pose = CanonicalRelativePose({Eigen::Quaterniond(0.8, 0, 0.6, 0), Eigen::Vector3d::Zero()});
  EXPECT_EQ(pose.translation, Eigen::Vector3d::Zero());
  EXPECT_NEAR(pose.rotation.y(), 0.6, 2e-10);
}

// A pose that went through its inverse is the same bit for bit, but for the few on the edge of rounding.
TEST(CanonicalRelativePose, StoredInverseGivesTheSame) {
  std::mt19937 random(3);
  int num_different = 0;
  for (int i = 0; i < 10000; ++i) {
    const Rigid3d pose = RandomPose(&random);
    const Rigid3d a = CanonicalRelativePose(pose), b = CanonicalRelativePose(Inverse(Inverse(pose)));
    EXPECT_LE((a.translation - b.translation).norm(), 4e-12);
    num_different += !IsSame(a, b);
  }
  EXPECT_LE(num_different, 15);
}

TEST(Inverted, SwapsEverything) {
  std::mt19937 random(4);
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::PLANAR;
  geometry.inlier_matches = {{1, 2}, {3, 4}};
  geometry.query_from_other = RandomPose(&random);
  geometry.H = Eigen::Matrix3d(RandomPose(&random).rotation) * 2;
  geometry.query_camera = Camera();
  geometry.query_camera->camera_id = 7;

  const TwoViewGeometry inverted = Inverted(geometry);
  EXPECT_EQ(inverted.config, TwoViewConfig::PLANAR);
  EXPECT_EQ(inverted.inlier_matches, (Matches{{2, 1}, {4, 3}}));
  const Eigen::Vector3d point(1, 2, 3);
  EXPECT_LE((*inverted.query_from_other * (*geometry.query_from_other * point) - point).norm(), 1e-14);
  EXPECT_TRUE((*inverted.H * *geometry.H).isIdentity(1e-14));
  EXPECT_FALSE(inverted.query_camera);
  EXPECT_EQ(inverted.other_camera->camera_id, 7u);
  EXPECT_FALSE(inverted.E || inverted.F);
}

TEST(Inverted, LeavesOutTheInverseOfASingularHomography) {
  TwoViewGeometry geometry;
  geometry.H = Eigen::Vector3d(1, 1, 0).asDiagonal();
  EXPECT_FALSE(Inverted(geometry).H);
}

}  // namespace
}  // namespace lazyloc
