#include "colmap_lazyloc/epoch/control_marks.h"

#include <random>

#include <gmock/gmock.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr int kNumImages = 5, kNumPoints = 4;

// Returns a scene of database images with exact marks of control points that were surveyed away from where they are.
JointScene MakeScene(const Eigen::Vector3d& shift) {
  const Camera camera = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), /*focal_length_px=*/600, 800, 600);
  JointScene scene;
  scene.cameras = {{camera, true}};
  for (int i = 0; i < kNumImages; ++i) {
    scene.images.push_back({0, LookAt({2.0 * i - 4, -8, 1}, Eigen::Vector3d::Zero()), true, 1, {}});
  }
  for (int i = 0; i < kNumPoints; ++i) {
    JointPoint point;
    const Eigen::Vector3d place(0.5 * i - 1, 0.3 * i * i, 0.2 * i);
    point.survey = Survey{place - shift, Eigen::Vector3d::Constant(0.01), 1};
    for (int image = 0; image < kNumImages; ++image) {
      point.observations.push_back({image, static_cast<uint32_t>(i)});
      scene.images[image].keypoints.push_back(*ImageFromCam(camera, scene.images[image].cam_from_world * place));
    }
    scene.control_points.push_back(std::move(point));
  }
  return scene;
}

TEST(FindFittingMarks, ShiftOfTheSurveyDoesNotMatter) {
  const JointScene scene = MakeScene({0.3, -0.5, 0.1});
  const ControlMarks marks = FindFittingMarks(scene);
  EXPECT_TRUE(marks.wrong.empty());
  ASSERT_EQ(marks.points.size(), kNumPoints);
  EXPECT_EQ(marks.points[1].observations.size(), kNumImages);
  EXPECT_TRUE(marks.points[1].point_in_world.isApprox(Eigen::Vector3d(-0.5, 0.3, 0.2), 1e-6));
}

TEST(FindFittingMarks, WrongMarkIsFound) {
  JointScene scene = MakeScene({0.3, -0.5, 0.1});
  scene.images[3].keypoints[2].x() += 40;
  const ControlMarks marks = FindFittingMarks(scene);
  ASSERT_EQ(marks.wrong.size(), 1);
  EXPECT_EQ(marks.wrong[0].control_point, 2);
  EXPECT_EQ(marks.wrong[0].image, 3);
  EXPECT_NEAR(marks.wrong[0].error_px, 40, 0.1);
  EXPECT_EQ(marks.points[2].observations.size(), kNumImages - 1);
}

TEST(FindFittingMarks, PointThatWasSurveyedElsewhereHasNoMarks) {
  JointScene scene = MakeScene({0.3, -0.5, 0.1});
  scene.control_points[2].survey->place.z() += 1;
  const ControlMarks marks = FindFittingMarks(scene);
  EXPECT_EQ(marks.wrong.size(), kNumImages);
  EXPECT_TRUE(marks.points[2].observations.empty());
  EXPECT_EQ(marks.points[1].observations.size(), kNumImages);
}

TEST(FindFittingMarks, MarksInPhotosWithoutPointsAreLeftOut) {
  JointScene scene = MakeScene({0, 0, 0});
  scene.images[0].is_database = scene.images[1].is_database = false;
  scene.points.push_back({Eigen::Vector3d::Zero(), {{0, 0}, {2, 0}}});
  const ControlMarks marks = FindFittingMarks(scene);
  EXPECT_TRUE(marks.wrong.empty());
  EXPECT_THAT(marks.points[0].observations, testing::SizeIs(kNumImages - 1));
  EXPECT_EQ(marks.points[0].observations[1].image, 2);
}

TEST(FindFittingMarks, SingleMarkIsComparedWithTheShiftOfTheOthers) {
  JointScene scene = MakeScene({0.3, -0.5, 0.1});
  scene.control_points[0].observations.resize(1);
  EXPECT_TRUE(FindFittingMarks(scene).wrong.empty());
  scene.images[0].keypoints[0].y() += 30;
  EXPECT_EQ(FindFittingMarks(scene).wrong.size(), 1);
}

}  // namespace
}  // namespace lazyloc
