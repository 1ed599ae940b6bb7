#include "colmap_lazyloc/scene/plane_fit.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr double kDistance = 4;

// Points of a slanted plane, of which the first are false.
class PlaneFitTest : public ::testing::Test {
 protected:
  std::vector<Track> MakeTracks(int num_false) {
    std::vector<Track> tracks(100);
    for (int i = 0; i < 100; ++i) {
      const Eigen::Vector2d place = 3 * RandomVector(&random_).head<2>();
      Eigen::Vector3d point_in_cam(place.x(), place.y(), kDistance + 0.3 * place.x() - 0.1 * place.y());
      if (i < num_false) point_in_cam *= 1.5;
      tracks[i].point_in_world = Inverse(cam_from_world_) * point_in_cam;
    }
    return tracks;
  }

  Random random_{3};
  const Rigid3d cam_from_world_ = LookAt({1, 2, -5}, {0.3, 0, 1});
  const Eigen::Vector3d normal_ = Eigen::Vector3d(-0.3, 0.1, 1) / kDistance;
};

TEST_F(PlaneFitTest, IsExactForPointsOfAPlane) {
  const std::vector<Track> tracks = MakeTracks(0);
  const PlaneFit fit = FitPlane(cam_from_world_, Refs(tracks));
  EXPECT_LE((fit.normal - normal_).norm(), 1e-9);
  EXPECT_LE(fit.errors.cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LE((fit.rays.rowwise().norm().array() - 1).abs().maxCoeff(), 1e-12);
}

TEST_F(PlaneFitTest, FalsePointsHardlyTurnIt) {
  const std::vector<Track> tracks = MakeTracks(20);
  const PlaneFit fit = FitPlane(cam_from_world_, Refs(tracks));
  EXPECT_LE((fit.normal - normal_).norm(), 0.01 * normal_.norm());
  EXPECT_GE(fit.errors.head(20).minCoeff(), 0.02) << "of false points";
  EXPECT_LE(fit.errors.tail(80).cwiseAbs().maxCoeff(), 0.01) << "of right points";
}

}  // namespace
}  // namespace lazyloc
