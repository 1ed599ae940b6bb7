#include "colmap_lazyloc/group/query_camera.h"

#include <limits>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

TEST(QueryCamera, ObservesTheQueryByItsPresentFocalLength) {
  SyntheticGroupOptions options;
  options.num_sensors = 1;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  const StageInput input = MakeStageInput(scene);
  LocalizationProblem& problem = scene.group.images[0].problem;
  problem.query_keypoints[5].x() = std::numeric_limits<double>::quiet_NaN();
  QueryCamera camera(problem);
  camera.ScaleFocalLength(2);
  EXPECT_EQ(camera.Intrinsics().params[0], 1600);
  const std::vector<Track> tracks = camera.Observe(input.tracks);
  ASSERT_EQ(tracks.size(), input.tracks.size() - 1);
  for (const Track& track : tracks) {
    const TrackObservation& query = track.observations[0];
    const Track& before = input.tracks[query.keypoint];
    EXPECT_NE(query.keypoint, 5);
    const Eigen::Vector2d before_xy = before.observations[0].observation.ray_in_cam.hnormalized();
    EXPECT_LE((2 * query.observation.ray_in_cam.hnormalized() - before_xy).norm(), 1e-12);
    EXPECT_EQ(track.observations[1].observation.ray_in_cam, before.observations[1].observation.ray_in_cam);
  }
}

}  // namespace
}  // namespace lazyloc
