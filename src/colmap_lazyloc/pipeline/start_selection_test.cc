#include "colmap_lazyloc/pipeline/start_selection.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/stages_test_input.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

const TrackRefs kNoTracks;

// Holds the tracks of a scene as evidence for its first frame: all have points, or none has.
class Evidence {
 public:
  Evidence(const SyntheticTracks& scene, double max_error_px, bool has_points = true)
      : tracks_(Refs(scene.tracks)),
        evidence_{scene.posed, has_points ? tracks_ : kNoTracks, has_points ? kNoTracks : tracks_, max_error_px} {}
  Evidence(const Evidence&) = delete;
  operator const StartEvidence&() const { return evidence_; }  // NOLINT(google-explicit-constructor)

 private:
  const TrackRefs tracks_;
  const StartEvidence evidence_;
};

const Rigid3d& TrueQueryPose(const SyntheticTracks& scene) { return scene.posed.frames[0].frame_from_world; }

// Leaves each track one database image, in turn.
SyntheticTracks SingleImageTracks(double noise_px) {
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
  EXPECT_LE(PositionError(*pose, TrueQueryPose(scene)), 0.1);
}

TEST(StartSelection, GeneralizedRelativePoseNeedsNoPointOfTwoDatabaseImages) {
  const SyntheticTracks scene = SingleImageTracks(0.2);
  const Evidence evidence(scene, 16, /*has_points=*/false);
  EXPECT_FALSE(AbsolutePoseStart(evidence, 1).has_value());
  const std::optional<Rigid3d> pose = GeneralizedRelativePoseStart(evidence, 1);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(PositionError(*pose, TrueQueryPose(scene)), 0.5);
  EXPECT_LE(RotationErrorDeg(*pose, TrueQueryPose(scene)), 5);
}

TEST(StartSelection, ScorePrefersTheTruth) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = TrueQueryPose(scene);
  Rigid3d wrong = truth;
  wrong.translation += Eigen::Vector3d(0.1, 0, 0);
  EXPECT_NEAR(ScoreStart(Evidence(scene, 16), truth), static_cast<double>(scene.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(Evidence(scene, 16), wrong), ScoreStart(Evidence(scene, 16), truth));
  const SyntheticTracks single = SingleImageTracks(0);
  const Evidence evidence(single, 16, /*has_points=*/false);
  EXPECT_NEAR(ScoreStart(evidence, truth), 0.5 * static_cast<double>(single.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(evidence, wrong), ScoreStart(evidence, truth));
}

TEST(StartSelection, ScoreIsTruncated) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = TrueQueryPose(scene);
  // Keeps six right points: the truth still scores on them.
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
