#include "colmap_lazyloc/group/layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;

SyntheticGroup MakeGroup(int num_frames, int num_sensors, int num_database_images) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_database_images = num_database_images;
  return MakeSyntheticGroup(options);
}

// Moves a pose as given to the coordinates of the layout.
Rigid3d Local(Rigid3d cam_from_world, const Layout& layout) {
  cam_from_world.rotation.normalize();
  cam_from_world.translation += cam_from_world.rotation * layout.origin;
  return cam_from_world;
}

// Calls visit(image, pair) for all database images of a group.
template <typename Visit>
void VisitDatabaseImages(const QueryGroup& group, const Layout& layout, const Visit& visit) {
  for (size_t query = 0; query < group.images.size(); ++query) {
    const std::vector<ImagePair>& pairs = group.images[query].problem.pairs;
    ASSERT_EQ(layout.image_of_pair[query].size(), pairs.size());
    for (size_t i = 0; i < pairs.size(); ++i) visit(layout.image_of_pair[query][i], pairs[i]);
  }
}

void NameDatabaseFrames(const std::vector<std::string>& names, QueryGroup* group) {
  for (QueryImage& query : group->images) {
    ASSERT_EQ(query.problem.pairs.size(), names.size());
    for (size_t i = 0; i < names.size(); ++i) query.problem.pairs[i].database_frame_name = names[i];
  }
}

TEST(MakeLayout, QueriesComeFirst) {
  const Layout layout = MakeLayout(MakeGroup(2, 3, 4).group);
  EXPECT_EQ(layout.num_queries, 6);
  EXPECT_EQ(layout.num_query_frames, 2);
  ASSERT_EQ(layout.given.images.size(), 6u + 2 * 4);
  ASSERT_EQ(layout.names.size(), layout.given.images.size());
  EXPECT_EQ(layout.given.frames.size(), 2u + 2 * 4);
  EXPECT_THAT(layout.QueriesOf(0), ElementsAre(0, 1, 2));
  EXPECT_THAT(layout.QueriesOf(1), ElementsAre(3, 4, 5));
  EXPECT_EQ(layout.names[4], "query1-1");
  EXPECT_EQ(layout.names[6], "database100");
  for (int image = 0; image < static_cast<int>(layout.given.images.size()); ++image) {
    EXPECT_EQ(layout.IsDatabase(image), image >= 6);
    EXPECT_EQ(layout.given.IsDatabase(image), image >= 6);
  }
}

TEST(MakeLayout, EachQueryFrameHasDatabaseFramesOfItsOwn) {
  const SyntheticGroup scene = MakeGroup(2, 2, 3);
  {
    const Layout layout = MakeLayout(scene.group);
    for (const int query : {0, 1}) EXPECT_THAT(layout.image_of_pair[query], ElementsAre(4, 5, 6));
    for (const int query : {2, 3}) EXPECT_THAT(layout.image_of_pair[query], ElementsAre(7, 8, 9));
    for (int image = 4; image < 7; ++image) {
      EXPECT_NE(layout.FrameOf(image), layout.FrameOf(image + 3));
      EXPECT_EQ(layout.names[image], layout.names[image + 3]);
      ExpectSameBits(CamFromWorld(layout.given, image), CamFromWorld(layout.given, image + 3));
    }
  }
}

TEST(MakeLayout, FirstImageHasTheAxesOfItsFrame) {
  SyntheticGroup scene = MakeGroup(2, 3, 2);
  Random random(1);
  const Rigid3d rig_from_other_rig{RandomRotation(&random), RandomVector(&random)};
  for (QueryImage& query : scene.group.images) query.cam_from_rig = query.cam_from_rig * rig_from_other_rig;
  const Layout layout = MakeLayout(scene.group);
  for (int query = 0; query < layout.num_queries; ++query) {
    const Image& image = layout.given.images[query];
    const int first = layout.QueriesOf(image.frame).front();
    EXPECT_EQ(HasFrameAxes(image), query == first);
    const Rigid3d cam_from_world = CamFromWorld(image, scene.cam_from_world[first]);
    EXPECT_LE(PositionError(cam_from_world, scene.cam_from_world[query]), 1e-12);
    EXPECT_LE(RotationErrorDeg(cam_from_world, scene.cam_from_world[query]), 1e-5);
  }
}

TEST(MakeLayout, OnlyFramesOfSeveralImagesHaveAFreeScale) {
  for (const int num_sensors : {1, 2}) {
    SyntheticGroup scene = MakeGroup(2, num_sensors, 2);
    for (const bool has_rig_scale : {true, false}) {
      scene.group.has_rig_scale = has_rig_scale;
      for (const Frame& frame : MakeLayout(scene.group).given.frames) {
        EXPECT_EQ(frame.has_free_scale, !frame.is_database && num_sensors == 2 && !has_rig_scale);
      }
    }
  }
}

TEST(MakeLayout, ImagesStartWithTheNoiseOfTheStart) {
  for (const Image& image : MakeLayout(MakeGroup(1, 2, 2).group).given.images) {
    EXPECT_EQ(image.noise_px, kStartNoisePx);
  }
}

// Allows errors of 1e-7, because doubles near 5.4e6 are 1e-9 apart.
TEST(MakeLayout, OriginIsTheMeanOfTheDatabaseCentres) {
  SyntheticSceneOptions options;
  options.origin = {500000, 5400000, 300};
  const QueryGroup group = LoneQuery(MakeSyntheticScene(options));
  const Layout layout = MakeLayout(group);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  VisitDatabaseImages(group, layout, [&](int image, const ImagePair& pair) {
    const Eigen::Vector3d centre = CamInWorld(CamFromWorld(layout.given, image));
    EXPECT_LE((centre + layout.origin - CamInWorld(pair.database_cam_from_world)).norm(), 1e-7);
    EXPECT_LE(centre.norm(), 20);
    sum += centre;
  });
  EXPECT_LE(sum.norm(), 1e-6);
}

// Makes a group in which the database has frames of the queries' rig.
SyntheticGroup MakeGroupWithDatabaseRigs() {
  SyntheticGroupOptions options;
  options.num_database_images = 6;
  options.has_database_rigs = true;
  return MakeSyntheticGroup(options);
}

TEST(MakeLayout, DatabaseImagesOfOneRigFrameShareItAndTheQueriesCalibration) {
  const SyntheticGroup scene = MakeGroupWithDatabaseRigs();
  const Layout layout = MakeLayout(scene.group);
  ASSERT_EQ(layout.given.calibrations.size(), 1u);
  EXPECT_TRUE(layout.given.calibrations[0].is_stated_by_database);
  EXPECT_EQ(layout.given.images[1].calibration, 0) << "second query";
  EXPECT_EQ(layout.given.frames.size(), 1u + 6 / 2);
  VisitDatabaseImages(scene.group, layout, [&](int image, const ImagePair& pair) {
    EXPECT_EQ(layout.FrameOf(image), 1 + (image - 2) / 2);
    EXPECT_EQ(layout.given.images[image].calibration, image % 2 == 0 ? -1 : 0);
    const Rigid3d given = Local(pair.database_cam_from_world, layout);
    EXPECT_LE(PositionError(CamFromWorld(layout.given, image), given), 1e-12);
    EXPECT_LE(RotationErrorDeg(CamFromWorld(layout.given, image), given), 1e-5);
    if (image % 2 == 0) ExpectSameBits(CamFromWorld(layout.given, image), given);
  });
}

TEST(MakeLayout, AxesOfDatabaseFramesAreThoseOfTheQuerysCamera) {
  SyntheticGroup scene = MakeGroupWithDatabaseRigs();
  scene.group.images = {scene.group.images[1]};
  scene.group.query_pairs.clear();
  const Layout layout = MakeLayout(scene.group);
  ASSERT_EQ(layout.given.calibrations.size(), 1u) << "of the database frames alone";
  for (int image = 1; image < 7; ++image) EXPECT_EQ(HasFrameAxes(layout.given.images[image]), image % 2 == 0);
}

TEST(MakeLayout, DatabaseImagesThatStateNoRigidRigAreLoneFrames) {
  SyntheticGroup scene = MakeGroup(1, 2, 4);
  NameDatabaseFrames({"a", "a", "b", "b"}, &scene.group);
  const Layout layout = MakeLayout(scene.group);
  EXPECT_EQ(layout.given.calibrations.size(), 1u) << "of the queries";
  EXPECT_FALSE(layout.given.calibrations[0].is_stated_by_database);
  EXPECT_EQ(layout.given.frames.size(), 1u + 4);
  VisitDatabaseImages(scene.group, layout, [&](int image, const ImagePair& pair) {
    EXPECT_TRUE(HasFrameAxes(layout.given.images[image]));
    ExpectSameBits(CamFromWorld(layout.given, image), Local(pair.database_cam_from_world, layout));
  });
}

TEST(MakeLayout, FramesOfUnknownScaleShareNoCalibration) {
  SyntheticGroup scene = MakeGroup(2, 3, 2);
  EXPECT_EQ(MakeLayout(scene.group).given.calibrations.size(), 2u);
  scene.group.has_rig_scale = false;
  const Layout layout = MakeLayout(scene.group);
  EXPECT_EQ(layout.given.calibrations.size(), 4u);
  std::vector<int> calibrations;
  for (int query = 0; query < layout.num_queries; ++query) {
    calibrations.push_back(layout.given.images[query].calibration);
  }
  EXPECT_THAT(calibrations, testing::ElementsAre(-1, 0, 1, -1, 2, 3));
}

TEST(TracksByFrame, EachFrameHasATrackOnce) {
  const Layout layout = MakeLayout(MakeGroup(2, 2, 2).group);  // queries 0 1 | 2 3, database images 4 and above
  std::vector<Track> tracks(3);
  for (const int image : {0, 1, 4, 5}) tracks[0].observations.push_back({image, 0, {}});
  for (const int image : {1, 2, 3, 4}) tracks[1].observations.push_back({image, 1, {}});
  for (const int image : {3, 6, 7}) tracks[2].observations.push_back({image, 2, {}});
  EXPECT_THAT(TracksByFrame(layout, tracks),
              ElementsAre(ElementsAre(&tracks[0], &tracks[1]), ElementsAre(&tracks[1], &tracks[2])));
}

}  // namespace
}  // namespace lazyloc
