#include "colmap_lazyloc/testing/stage_input.h"

#include "colmap_lazyloc/bridge/observer.h"

namespace lazyloc {
namespace {

PairGeometry ObservedPair(int query, int other, const Camera& camera, const std::vector<Eigen::Vector2d>& keypoints,
                          const ImagePair& images) {
  const Observer observe_query(camera), observe_other(images.other_camera);
  PairGeometry pair;
  pair.query = query;
  pair.other = other;
  pair.query_from_other = *images.geometry->query_from_other;
  pair.num_inliers = static_cast<int>(images.geometry->inlier_matches.size());
  for (const Match& match : images.geometry->inlier_matches) {
    pair.inliers.push_back({match, *observe_query(keypoints[match.query_point]),
                            *observe_other(images.other_keypoints[match.other_point])});
  }
  return pair;
}

std::vector<Track> TracksOfQuery(const SyntheticGroup& scene, const Layout& layout, int query) {
  const LocalizationProblem& problem = scene.group.images[query].problem;
  const Observer observe(problem.query_camera);
  std::vector<Track> tracks;
  for (int i = 0; i < static_cast<int>(scene.points_in_world.size()); ++i) {
    Track track;
    track.point_in_world = scene.points_in_world[i] - layout.origin;
    track.observations.push_back({query, i, *observe(problem.query_keypoints[i])});
    for (size_t k = 0; k < problem.pairs.size(); ++k) {
      const Observer observe_database(problem.pairs[k].other_camera);
      track.observations.push_back(
          {layout.image_of_pair[query][k], i, *observe_database(problem.pairs[k].other_keypoints[i])});
    }
    tracks.push_back(track);
  }
  return tracks;
}

}  // namespace

SyntheticGroup MakeGroup(int num_frames, int num_sensors, int num_points, int num_database_images) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = num_points;
  options.num_database_images = num_database_images;
  return MakeSyntheticGroup(options);
}

StageInput MakeStageInput(const SyntheticGroup& scene) {
  StageInput input;
  input.layout = MakeLayout(scene.group);
  input.truth = input.layout.given;
  for (int query = input.layout.num_queries - 1; query >= 0; --query) {  // the first image of a frame is set last
    Rigid3d local = scene.cam_from_world[query];
    local.translation += local.rotation * input.layout.origin;
    input.truth.frames[input.layout.FrameOf(query)].frame_from_world = local;
  }
  for (int query = 0; query < input.layout.num_queries; ++query) {
    const LocalizationProblem& problem = scene.group.images[query].problem;
    for (size_t k = 0; k < problem.pairs.size(); ++k) {
      input.pairs.push_back(ObservedPair(query, input.layout.image_of_pair[query][k], problem.query_camera,
                                         problem.query_keypoints, problem.pairs[k]));
    }
    for (const Track& track : TracksOfQuery(scene, input.layout, query)) input.tracks.push_back(track);
  }
  for (const QueryPair& pair : scene.group.query_pairs) {
    const LocalizationProblem& problem = scene.group.images[pair.query].problem;
    input.pairs.push_back(
        ObservedPair(pair.query, pair.other, problem.query_camera, problem.query_keypoints, pair.images));
  }
  return input;
}

QueryGroup LoneQuery(const SyntheticScene& scene) {
  QueryGroup group;
  group.frame_names = {""};
  group.images.push_back({scene.problem, 0, {}});
  return group;
}

Rigid3d DisturbedPose(const Rigid3d& frame_from_world, double angle_deg, double distance, Random* random) {
  const Eigen::Quaterniond rotation = Disturbed(frame_from_world.rotation, angle_deg, random);
  return CamFromWorld(rotation, CamInWorld(frame_from_world) + distance * RandomVector(random).normalized());
}

void ExpectSameDatabasePoses(const PosedImages& a, const PosedImages& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].is_database, b.frames[i].is_database);
    if (a.frames[i].is_database) ExpectSameBits(a.frames[i].frame_from_world, b.frames[i].frame_from_world);
  }
}

void ExpectNear(const PosedImages& posed, const PosedImages& truth, double max_distance, double max_angle_deg) {
  ASSERT_EQ(posed.images.size(), truth.images.size());
  for (int image = 0; image < static_cast<int>(posed.images.size()); ++image) {
    const Rigid3d pose = CamFromWorld(posed, image), true_pose = CamFromWorld(truth, image);
    EXPECT_LE(PositionError(pose, true_pose), max_distance) << "image " << image;
    EXPECT_LE(RotationErrorDeg(pose, true_pose), max_angle_deg) << "image " << image;
  }
}

}  // namespace lazyloc
