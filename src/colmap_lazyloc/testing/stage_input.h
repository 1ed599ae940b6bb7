#pragma once

#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/structure/track_triangulation.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_group.h"

namespace lazyloc {

// What the stages take, made from the truth of a synthetic group without running a stage before.
struct StageInput {
  Layout layout;
  PosedImages truth;                // the layout's images and frames, query frames with their true poses
  std::vector<PairGeometry> pairs;  // stored relative poses and matches
  // One track for each query and point, observed by the query and its database images, with the true point.
  std::vector<Track> tracks;
};

StageInput MakeStageInput(const SyntheticGroup& scene);

SyntheticGroup MakeGroup(int num_frames, int num_sensors, int num_points, int num_database_images);

// Returns options that take database poses and given focal lengths as exact, so that covariances are those of the
// keypoints alone.
inline LocalizerOptions WithExactDatabase(LocalizerOptions options = {}) {
  options.database_pose_stddev_deg = options.database_pose_stddev_length = options.focal_length_stddev_ratio = 0;
  return options;
}

// Returns a scene's query as a group of its own.
QueryGroup LoneQuery(const SyntheticScene& scene);

// Returns the failure that a stage throws; expects it to throw one.
template <typename Stage>
Failure FailureOf(const Stage& stage) {
  try {
    stage();
  } catch (const Failure& failure) {
    return failure;
  }
  ADD_FAILURE() << "the stage throws no failure";
  return {QueryStatus::LOCALIZED, ""};
}

// Moves a frame's pose by an angle and a distance in random directions.
Rigid3d DisturbedPose(const Rigid3d& frame_from_world, double angle_deg, double distance, Random* random);

// Expects equal bits of the poses of all database frames.
void ExpectSameDatabasePoses(const PosedImages& a, const PosedImages& b);

// Expects the poses of all images to be within the bounds of the truth.
void ExpectNear(const PosedImages& posed, const PosedImages& truth, double max_distance, double max_angle_deg);

}  // namespace lazyloc
