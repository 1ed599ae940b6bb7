#include "colmap_lazyloc/pipeline/start_selection.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

TEST(StartSelection, AbsolutePoseReplacesABadStart) {
  SyntheticTracksOptions options;
  options.noise_px = 0.5;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  const Rigid3d truth = scene.views[0].cam_from_world;
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(1, 0, 0);
  const Rigid3d chosen = ChooseStart(scene.views, scene.tracks, /*max_error_px=*/16, /*seed=*/1);
  EXPECT_LE(PositionError(chosen, truth), 0.1);
}

TEST(StartSelection, BetterStartStays) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = scene.views[0].cam_from_world;
  // Points of which most are wrong: RANSAC has little to hold on to, the truth still scores on the right ones.
  Random random(1);
  for (size_t i = 6; i < scene.tracks.size(); ++i) scene.tracks[i].point_in_world = 2 * RandomVector(&random);
  const Rigid3d chosen = ChooseStart(scene.views, scene.tracks, /*max_error_px=*/4, /*seed=*/1);
  EXPECT_LE(PositionError(chosen, truth), 0.05);
}

TEST(StartSelection, FewTracksChangeNothing) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.tracks.resize(3);
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(1, 0, 0);
  const Rigid3d chosen = ChooseStart(scene.views, scene.tracks, 16, 1);
  EXPECT_EQ(chosen.translation, scene.views[0].cam_from_world.translation);
}

TEST(StartSelection, SameSeedSameResult) {
  SyntheticTracksOptions options;
  options.noise_px = 2;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(1, 0, 0);
  const Rigid3d first = ChooseStart(scene.views, scene.tracks, 16, 5),
                second = ChooseStart(scene.views, scene.tracks, 16, 5);
  EXPECT_EQ(first.rotation.coeffs(), second.rotation.coeffs());
  EXPECT_EQ(first.translation, second.translation);
}

}  // namespace
}  // namespace lazyloc
