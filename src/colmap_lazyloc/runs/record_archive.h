#pragma once

#include <sstream>
#include <string>

#include <cereal/archives/portable_binary.hpp>
#include <cereal/types/optional.hpp>
#include <cereal/types/string.hpp>
#include <cereal/types/utility.hpp>
#include <cereal/types/vector.hpp>

#include "colmap_lazyloc/scene/query_record.h"

// How cereal reads and writes what a QueryRecord holds. Names all members of each type, so that one that is added does
// not compile before it is named here too.
#define LAZYLOC_ARCHIVE(Type, ...)                \
  template <typename Archive>                     \
  void serialize(Archive& archive, Type& value) { \
    auto& [__VA_ARGS__] = value;                  \
    archive(__VA_ARGS__);                         \
  }

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

LAZYLOC_ARCHIVE(Rigid3d, rotation, translation)
LAZYLOC_ARCHIVE(Camera, camera_id, model_id, width, height, params, has_prior_focal_length)
LAZYLOC_ARCHIVE(PairResult, database_name, num_inliers, rotation_error_deg, direction_error_deg)
LAZYLOC_ARCHIVE(PointResult, point_in_world, query_point, observations, mean_reprojection_error_px)
LAZYLOC_ARCHIVE(PoseSpread, rotation_stddev_rad, position_stddevs, weakest_direction_in_world)
LAZYLOC_ARCHIVE(Bearing, database_name, dir_database_to_query_in_world, stddev_rad)
LAZYLOC_ARCHIVE(PartialPose, cam_from_world_rotation, rotation_stddev_rad, bearing)
LAZYLOC_ARCHIVE(PriorResult, verdict, fixes, deviation, deviation_sigma)
LAZYLOC_ARCHIVE(QueryPriorResult, position, gravity)
LAZYLOC_ARCHIVE(IntrinsicsResult, origin, verdict, focal_factor, focal_factor_stddev, contradiction, covariance)

template <typename Archive>
void serialize(Archive& archive, PoseEvidence& evidence) {
  ForEachEvidence(evidence, [&](const char*, double* value) { archive(*value); });
}

LAZYLOC_ARCHIVE(RunnerUp, explanation, cam_from_world, odds)
LAZYLOC_ARCHIVE(DepthMapResult, database_name, verdict, num_points, scale, scale_stddev, depth_stddev)
LAZYLOC_ARCHIVE(DepthResult, maps, num_points, fixes_distance)
LAZYLOC_ARCHIVE(DatabasePoseNoise, source, num_pairs, viewpoint_px, rotation_px, position_px)

LAZYLOC_ARCHIVE(EpochResult, hangs_on_others, is_adjusted, shift)

// Leaves the points out, which are a part of their own.
template <typename Archive>
void serialize(Archive& archive, LocalizationResult& result) {
  auto& [query_name, status, is_camera_refined, reason, query_camera, intrinsics, priors, frame_name, rig_error_px,
         cam_from_world, rig_from_world, rig_scale, covariance, spread, confidence, evidence, runner_up, partial_pose,
         database_pose_noise, depth, start, pairs, points, num_tracks, num_observations, mean_reprojection_error_px,
         seconds] = result;
  static_cast<void>(points);
  archive(query_name, status, is_camera_refined, reason, query_camera, intrinsics, priors, frame_name, rig_error_px,
          cam_from_world, rig_from_world, rig_scale, covariance, spread, confidence, evidence, runner_up, partial_pose,
          database_pose_noise, depth, start, pairs, num_tracks, num_observations, mean_reprojection_error_px, seconds);
}

// Leaves the keypoints out, which are a part of their own.
template <typename Archive>
void serialize(Archive& archive, QueryRecord& record) {
  auto& [result, keypoints, seconds, total_seconds, intrinsics_source, matcher, damages, epoch] = record;
  static_cast<void>(keypoints);
  archive(result, seconds, total_seconds, intrinsics_source, matcher, damages, epoch);
}

// Returns the bytes of a value, the same on every machine.
template <typename T>
std::string Pack(const T& value) {
  std::ostringstream stream;
  cereal::PortableBinaryOutputArchive archive(stream);
  archive(value);
  return stream.str();
}

}  // namespace lazyloc
