#include "colmap_lazyloc/pipeline/start_selection.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

const std::vector<Track> kNoTracks;

StartEvidence Evidence(const SyntheticTracks& scene, double max_error_px) {
  return {scene.views, scene.tracks, kNoTracks, max_error_px};
}

// Every track keeps one database view, not all the same.
SyntheticTracks SingleViewTracks(double noise_px) {
  SyntheticTracksOptions options;
  options.noise_px = noise_px;
  options.num_points = 200;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (size_t i = 0; i < scene.tracks.size(); ++i) {
    std::vector<TrackObservation>& observations = scene.tracks[i].observations;
    observations = {observations[0], observations[1 + i % (observations.size() - 1)]};
  }
  return scene;
}

TEST(StartSelection, AbsolutePoseIsNearTheTruth) {
  SyntheticTracksOptions options;
  options.noise_px = 0.5;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  const std::optional<Rigid3d> pose = AbsolutePoseStart(Evidence(scene, 16), /*seed=*/1);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(PositionError(*pose, scene.views[0].cam_from_world), 0.1);
}

TEST(StartSelection, GeneralizedRelativePoseNeedsNoPointSeenTwice) {
  const SyntheticTracks scene = SingleViewTracks(0.2);
  const StartEvidence evidence{scene.views, kNoTracks, scene.tracks, 16};
  EXPECT_FALSE(AbsolutePoseStart(evidence, 1).has_value());
  const std::optional<Rigid3d> pose = GeneralizedRelativePoseStart(evidence, 1);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(PositionError(*pose, scene.views[0].cam_from_world), 0.5);
  EXPECT_LE(RotationErrorDeg(*pose, scene.views[0].cam_from_world), 5);
}

TEST(StartSelection, ScorePrefersTheTruth) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = scene.views[0].cam_from_world;
  Rigid3d wrong = truth;
  wrong.translation += Eigen::Vector3d(0.1, 0, 0);
  EXPECT_NEAR(ScoreStart(Evidence(scene, 16), truth), static_cast<double>(scene.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(Evidence(scene, 16), wrong), ScoreStart(Evidence(scene, 16), truth));
  const SyntheticTracks single = SingleViewTracks(0);
  const StartEvidence evidence{single.views, kNoTracks, single.tracks, 16};
  EXPECT_NEAR(ScoreStart(evidence, truth), 0.5 * static_cast<double>(single.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(evidence, wrong), ScoreStart(evidence, truth));
}

TEST(StartSelection, ScoreIsTruncated) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = scene.views[0].cam_from_world;
  // Points of which most are wrong: the truth still scores on the right ones.
  Random random(1);
  for (size_t i = 6; i < scene.tracks.size(); ++i) scene.tracks[i].point_in_world = 2 * RandomVector(&random);
  EXPECT_GE(ScoreStart(Evidence(scene, 4), truth), 6 - 1e-6);
}

TEST(StartSelection, FewTracksGiveNoHypothesis) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.tracks.resize(2);
  EXPECT_FALSE(AbsolutePoseStart(Evidence(scene, 16), 1).has_value());
  EXPECT_FALSE(GeneralizedRelativePoseStart(Evidence(scene, 16), 1).has_value());
}

TEST(StartSelection, SameSeedSameResult) {
  SyntheticTracksOptions options;
  options.noise_px = 2;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  for (const auto estimate : {AbsolutePoseStart, GeneralizedRelativePoseStart}) {
    const std::optional<Rigid3d> first = estimate(Evidence(scene, 16), 5), second = estimate(Evidence(scene, 16), 5);
    ASSERT_TRUE(first && second);
    EXPECT_EQ(first->rotation.coeffs(), second->rotation.coeffs());
    EXPECT_EQ(first->translation, second->translation);
  }
}

}  // namespace
}  // namespace lazyloc
