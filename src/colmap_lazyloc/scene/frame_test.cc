#include "colmap_lazyloc/scene/frame.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

// Returns a pose whose rotation has another length than one, as text files have it: normalising changes its bits.
Rigid3d PoseFromText(Random* random) {
  Rigid3d pose = {RandomRotation(random), RandomVector(random)};
  pose.rotation.coeffs() *= 1 + 1e-7;
  return pose;
}

// Makes two frames: a query rig of images 0 and 1, and a single database image 2.
PosedImages MakeRigAndLoneImage() {
  Random random(3);
  PosedImages posed;
  posed.frames.resize(2);
  for (Frame& frame : posed.frames) frame.frame_from_world = PoseFromText(&random);
  posed.frames[1].is_database = true;
  posed.images.resize(3);
  posed.images[0].frame = posed.images[1].frame = 0;
  posed.images[1].cam_from_frame = {RandomRotation(&random), RandomVector(&random)};
  posed.images[2].frame = 1;
  return posed;
}

TEST(Image, HasFrameAxesIfItsOffsetIsExactlyIdentity) {
  Image image;
  EXPECT_TRUE(HasFrameAxes(image));
  image.cam_from_frame.translation.y() = 1e-300;
  EXPECT_FALSE(HasFrameAxes(image));
  image.cam_from_frame.translation.setZero();
  image.cam_from_frame.rotation.x() = 1e-300;
  EXPECT_FALSE(HasFrameAxes(image));
}

TEST(CamFromWorld, OfAnImageWithFrameAxesIsTheFramesPoseBitwise) {
  const PosedImages posed = MakeRigAndLoneImage();
  ASSERT_NE(posed.frames[1].frame_from_world.rotation.normalized().coeffs(),
            posed.frames[1].frame_from_world.rotation.coeffs());
  ExpectSameBits(CamFromWorld(posed, 0), posed.frames[0].frame_from_world);
  ExpectSameBits(CamFromWorld(posed, 2), posed.frames[1].frame_from_world);
}

TEST(CamFromWorld, OfARigsImageComposes) {
  const PosedImages posed = MakeRigAndLoneImage();
  const Rigid3d cam_from_world = CamFromWorld(posed, 1);
  const Eigen::Vector3d point_in_world(1, -2, 3);
  const Eigen::Vector3d point_in_frame = posed.frames[0].frame_from_world * point_in_world;
  EXPECT_LE((cam_from_world * point_in_world - posed.images[1].cam_from_frame * point_in_frame).norm(), 1e-5);
  ExpectSameBits(cam_from_world, posed.images[1].cam_from_frame * posed.frames[0].frame_from_world);
  ExpectSameBits(cam_from_world, CamFromWorld(posed.images[1], posed.frames[0].frame_from_world));
}

TEST(PosedImages, GiveThePosesOfAllImages) {
  const PosedImages posed = MakeRigAndLoneImage();
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  ASSERT_EQ(cams_from_world.size(), 3u);
  for (int image = 0; image < 3; ++image) ExpectSameBits(cams_from_world[image], CamFromWorld(posed, image));
}

TEST(PosedImages, ImagesBelongToTheirFrames) {
  const PosedImages posed = MakeRigAndLoneImage();
  EXPECT_EQ(&posed.FrameOf(1), &posed.frames[0]);
  EXPECT_EQ(&posed.FrameOf(2), &posed.frames[1]);
  EXPECT_FALSE(posed.IsDatabase(1));
  EXPECT_TRUE(posed.IsDatabase(2));
}

TEST(Frame, IsConstantIfItIsOfTheDatabaseAndHasNoPrior) {
  Frame frame;
  EXPECT_FALSE(IsConstant(frame));
  frame.is_database = true;
  EXPECT_TRUE(IsConstant(frame));
  frame.prior = PosePrior();
  EXPECT_FALSE(IsConstant(frame));
}

}  // namespace
}  // namespace lazyloc
