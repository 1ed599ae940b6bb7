#include "colmap_lazyloc/features/guided_matching.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/features/descriptor_matching.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using ::testing::IsEmpty;

constexpr double kMaxErrorRad = 0.002;

// Points that two cameras see, with alike descriptors, in the reverse order in the other image.
struct Views {
  Descriptors query_descriptors, other_descriptors;
  Rays query_rays, other_rays;
  Rigid3d query_from_other;

  Eigen::Matrix3d E() const { return Hat(query_from_other.translation) * query_from_other.rotation.toRotationMatrix(); }
  Matches Match() const {
    return MatchAlongEpipolarLines({query_descriptors, query_rays}, {other_descriptors, other_rays}, E(), kMaxErrorRad);
  }
};

// baseline: from the other camera to the query, whose axes are turned a little; points are 4 to 8 in front.
Views MakeViews(int num_points, const Eigen::Vector3d& baseline, double noise_rad, uint32_t seed) {
  Random random(seed);
  Views views;
  const Eigen::Quaterniond rotation = Disturbed(Eigen::Quaterniond::Identity(), 5, &random);
  views.query_from_other = {rotation, -(rotation * baseline)};
  views.query_descriptors = RandomDescriptors(num_points, seed);
  views.other_descriptors = WithNoise(views.query_descriptors, seed + 1).colwise().reverse();
  std::uniform_real_distribution<double> across(-3, 3), along(4, 8);
  for (int i = 0; i < num_points; ++i) {
    const Eigen::Vector3d point(across(random), across(random), along(random));
    const Eigen::Vector3d in_query = rotation * (point - baseline);
    views.other_rays.push_back((point.normalized() + noise_rad * RandomVector(&random)).normalized());
    views.query_rays.push_back((in_query.normalized() + noise_rad * RandomVector(&random)).normalized());
  }
  std::reverse(views.other_rays.begin(), views.other_rays.end());
  return views;
}

// Returns for each descriptor of `a` the best one of `b` within Sampson's error, by definition; -1 if it is too
// different or not clearly the best.
std::vector<int> Nearest(const Views& views, bool of_query) {
  const Descriptors& a = of_query ? views.query_descriptors : views.other_descriptors;
  const Descriptors& b = of_query ? views.other_descriptors : views.query_descriptors;
  std::vector<int> nearest;
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    int best = 0, second = 0, index = -1;
    for (Eigen::Index j = 0; j < b.rows(); ++j) {
      const Eigen::Vector3d &query = views.query_rays[of_query ? i : j], &other = views.other_rays[of_query ? j : i];
      if (query.isZero() || other.isZero()) continue;
      if (SquaredEpipolarErrors({other}, {query}, views.E())[0] > kMaxErrorRad * kMaxErrorRad) continue;
      const int product = a.row(i).cast<int>().dot(b.row(j).cast<int>());
      second = std::max(second, std::min(best, product));
      if (product > best) index = static_cast<int>(j);
      best = std::max(best, product);
    }
    const auto angle = [](int product) { return std::acos(std::min(product / (512.0f * 512.0f), 1.0f)); };
    nearest.push_back(angle(best) <= 0.7f && angle(best) < 0.8f * angle(second) ? index : -1);
  }
  return nearest;
}

Matches MutualNearest(const Views& views) {
  const std::vector<int> of_query = Nearest(views, true), of_other = Nearest(views, false);
  Matches matches;
  for (size_t i = 0; i < of_query.size(); ++i) {
    if (of_query[i] < 0 || of_other[of_query[i]] != static_cast<int>(i)) continue;
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(of_query[i])});
  }
  return matches;
}

MATCHER(IsInReverseOrder, "") { return arg.other_point + arg.query_point == 399; }

TEST(MatchAlongEpipolarLines, FindsPointsThatBothCamerasSee) {
  for (const Eigen::Vector3d& baseline : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0.3, -0.8, 0.2)}) {
    const Matches matches = MakeViews(400, baseline, 1e-4, 1).Match();
    EXPECT_EQ(matches.size(), 400u);
    EXPECT_THAT(matches, ::testing::Each(IsInReverseOrder()));
  }
}

// Planes of every angle are in use, those where the angle begins again, too: the sets of matches are equal.
TEST(MatchAlongEpipolarLines, IsExactForCamerasSideBySide) {
  for (const uint32_t seed : {1, 2, 3, 4}) {
    // Descriptors of four kinds, so that the wrong point of a line often has the best descriptor.
    Views views = MakeViews(300, Eigen::Vector3d(0.2, 1, 0), 3e-4, seed);
    const Descriptors kinds = RandomDescriptors(40, seed);
    for (Eigen::Index i = 0; i < 300; ++i) {
      views.query_descriptors.row(i) = kinds.row(i % 40);
      views.other_descriptors.row(299 - i) = kinds.row(i % 40);
    }
    views.query_descriptors = WithNoise(views.query_descriptors, seed);
    const Matches matches = views.Match();
    EXPECT_EQ(matches, MutualNearest(views));
    EXPECT_LT(MatchDescriptors(views.query_descriptors, views.other_descriptors).size(), 30u);
    EXPECT_GT(matches.size(), 200u);
  }
}

// Near the epipole, a point's plane has no certain angle.
TEST(MatchAlongEpipolarLines, FindsPointsAheadOfAForwardMotion) {
  const Views views = MakeViews(400, Eigen::Vector3d(0, 0, 1), 1e-4, 1);
  const Matches matches = views.Match();
  EXPECT_THAT(matches, ::testing::Each(IsInReverseOrder()));
  EXPECT_GE(matches.size(), 395u);
}

TEST(MatchAlongEpipolarLines, LeavesOutPointsOffTheLine) {
  Views views = MakeViews(400, Eigen::Vector3d(1, 0, 0), 1e-4, 1);
  views.query_rays[7] = (views.query_rays[7] + Eigen::Vector3d(0, 0.05, 0)).normalized();
  const Matches matches = views.Match();
  EXPECT_EQ(matches.size(), 399u);
  EXPECT_TRUE(std::none_of(matches.begin(), matches.end(), [](const Match& match) { return match.query_point == 7; }));
}

TEST(MatchAlongEpipolarLines, LeavesOutPointsWithoutRays) {
  Views views = MakeViews(400, Eigen::Vector3d(1, 0, 0), 1e-4, 1);
  views.query_rays[7].setZero();
  views.other_rays[8].setZero();
  EXPECT_EQ(views.Match().size(), 398u);
  views.other_rays.assign(400, Eigen::Vector3d::Zero());
  EXPECT_THAT(views.Match(), IsEmpty());
}

}  // namespace
}  // namespace lazyloc
