#pragma once

#include <cereal/archives/portable_binary.hpp>
#include <cereal/types/optional.hpp>
#include <cereal/types/string.hpp>
#include <cereal/types/utility.hpp>
#include <cereal/types/vector.hpp>

#include "colmap_lazyloc/queries/query_record.h"

// How cereal reads and writes what a QueryRecord holds. Each function names all members of its type, so that one that
// is added does not compile before it is named here too.
namespace cereal {

template <typename Archive, int kRows, int kCols>
void serialize(Archive& archive, Eigen::Matrix<double, kRows, kCols>& matrix) {
  for (Eigen::Index i = 0; i < matrix.size(); ++i) archive(matrix.data()[i]);
}

template <typename Archive>
void serialize(Archive& archive, Eigen::Quaterniond& rotation) {
  archive(rotation.coeffs());
}

}  // namespace cereal

namespace lazyloc {

template <typename Archive>
void serialize(Archive& archive, Rigid3d& pose) {
  auto& [rotation, translation] = pose;
  archive(rotation, translation);
}

template <typename Archive>
void serialize(Archive& archive, Camera& camera) {
  auto& [camera_id, model_id, width, height, params, has_prior_focal_length] = camera;
  archive(camera_id, model_id, width, height, params, has_prior_focal_length);
}

template <typename Archive>
void serialize(Archive& archive, PairResult& pair) {
  auto& [database_name, num_inliers, rotation_error_deg, direction_error_deg] = pair;
  archive(database_name, num_inliers, rotation_error_deg, direction_error_deg);
}

template <typename Archive>
void serialize(Archive& archive, PointResult& point) {
  auto& [point_in_world, query_point, observations, mean_reprojection_error_px] = point;
  archive(point_in_world, query_point, observations, mean_reprojection_error_px);
}

template <typename Archive>
void serialize(Archive& archive, PoseSpread& spread) {
  auto& [rotation_stddev_rad, position_stddevs, weakest_direction_in_world] = spread;
  archive(rotation_stddev_rad, position_stddevs, weakest_direction_in_world);
}

template <typename Archive>
void serialize(Archive& archive, Bearing& bearing) {
  auto& [database_name, dir_database_to_query_in_world, stddev_rad] = bearing;
  archive(database_name, dir_database_to_query_in_world, stddev_rad);
}

template <typename Archive>
void serialize(Archive& archive, PartialPose& pose) {
  auto& [cam_from_world_rotation, rotation_stddev_rad, bearing] = pose;
  archive(cam_from_world_rotation, rotation_stddev_rad, bearing);
}

template <typename Archive>
void serialize(Archive& archive, PriorResult& prior) {
  auto& [verdict, fixes, deviation, deviation_sigma] = prior;
  archive(verdict, fixes, deviation, deviation_sigma);
}

template <typename Archive>
void serialize(Archive& archive, QueryPriorResult& priors) {
  auto& [position, gravity] = priors;
  archive(position, gravity);
}

template <typename Archive>
void serialize(Archive& archive, IntrinsicsResult& intrinsics) {
  auto& [origin, verdict, focal_factor, focal_factor_stddev, contradiction] = intrinsics;
  archive(origin, verdict, focal_factor, focal_factor_stddev, contradiction);
}

template <typename Archive>
void serialize(Archive& archive, PoseEvidence& evidence) {
  ForEachEvidence(evidence, [&](const char*, double* value) { archive(*value); });
}

template <typename Archive>
void serialize(Archive& archive, RunnerUp& runner_up) {
  auto& [explanation, cam_from_world, odds] = runner_up;
  archive(explanation, cam_from_world, odds);
}

template <typename Archive>
void serialize(Archive& archive, DepthMapResult& map) {
  auto& [database_name, verdict, num_points, scale, scale_stddev, depth_stddev] = map;
  archive(database_name, verdict, num_points, scale, scale_stddev, depth_stddev);
}

template <typename Archive>
void serialize(Archive& archive, DepthResult& depth) {
  auto& [maps, num_points, fixes_distance] = depth;
  archive(maps, num_points, fixes_distance);
}

template <typename Archive>
void serialize(Archive& archive, DatabasePoseNoise& noise) {
  auto& [source, num_pairs, viewpoint_px, rotation_px, position_px] = noise;
  archive(source, num_pairs, viewpoint_px, rotation_px, position_px);
}

// Leaves the points out, which are a part of their own.
template <typename Archive>
void serialize(Archive& archive, LocalizationResult& result) {
  auto& [query_name, status, reason, query_camera, is_camera_refined, intrinsics, priors, frame_name, rig_error_px,
         cam_from_world, rig_from_world, rig_scale, covariance, spread, confidence, evidence, runner_up, partial_pose,
         database_pose_noise, depth, start, pairs, points, num_tracks, num_observations, mean_reprojection_error_px,
         seconds] = result;
  static_cast<void>(points);
  archive(query_name, status, reason, query_camera, is_camera_refined, intrinsics, priors, frame_name, rig_error_px,
          cam_from_world, rig_from_world, rig_scale, covariance, spread, confidence, evidence, runner_up, partial_pose,
          database_pose_noise, depth, start, pairs, num_tracks, num_observations, mean_reprojection_error_px, seconds);
}

// Leaves the keypoints out, which are a part of their own.
template <typename Archive>
void serialize(Archive& archive, QueryRecord& record) {
  auto& [result, keypoints, seconds, total_seconds, intrinsics_source, matcher, damages] = record;
  static_cast<void>(keypoints);
  archive(result, seconds, total_seconds, intrinsics_source, matcher, damages);
}

}  // namespace lazyloc
