#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/database_pose_noise.h"
#include "colmap_lazyloc/scene/depth_result.h"
#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/scene/intrinsics_parameter.h"
#include "colmap_lazyloc/scene/pose_evidence.h"
#include "colmap_lazyloc/scene/query_prior.h"
#include "colmap_lazyloc/scene/query_status.h"

namespace lazyloc {

// Contribution of one database image. Residuals are NaN if the pair was not used.
struct PairResult {
  std::string database_name;
  int num_inliers = 0;
  double rotation_error_deg = 0;   // relative rotation against the final one
  double direction_error_deg = 0;  // relative translation direction against the final one
};

// A point triangulated for the query.
struct PointResult {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  int query_point = -1;                           // keypoint of the query
  std::vector<std::pair<int, int>> observations;  // index into `pairs`, keypoint of that database image
  double mean_reprojection_error_px = 0;          // over the query and the database images
};

// Standard deviations of a pose in all directions.
struct PoseSpread {
  double rotation_stddev_rad = 0;                                        // about the least certain axis
  Eigen::Vector3d position_stddevs = Eigen::Vector3d::Zero();            // along three principal axes, largest first
  Eigen::Vector3d weakest_direction_in_world = Eigen::Vector3d::Zero();  // the first of these axes, unit length
};

// Line on which the centre of a query lies.
struct Bearing {
  std::string database_name;
  Eigen::Vector3d dir_database_to_query_in_world = Eigen::Vector3d::Zero();  // unit length
  double stddev_rad = 0;                                                     // in the less certain of its two angles
};

// Known part of the pose of a query whose position is unobservable.
struct PartialPose {
  Eigen::Quaterniond cam_from_world_rotation = Eigen::Quaterniond::Identity();
  std::optional<double> rotation_stddev_rad;  // about the least certain axis
  std::optional<Bearing> bearing;
};

// What the images say of a query's intrinsics.
enum class IntrinsicsVerdict {
  NOT_TESTED,    // no bundle adjustment came to an end
  CONFIRMED,     // they agree with the value
  UNOBSERVABLE,  // they cannot tell; the value was kept
  CONTRADICTED,  // they suggest other intrinsics
  REFINED,       // the focal length was estimated
};
template <>
inline constexpr std::array<const char*, 5> kEnumNames<IntrinsicsVerdict> = {"not_tested", "confirmed", "unobservable",
                                                                             "contradicted", "refined"};

struct IntrinsicsResult {
  IntrinsicsOrigin origin = IntrinsicsOrigin::GIVEN;
  IntrinsicsVerdict verdict = IntrinsicsVerdict::NOT_TESTED;
  // Factor on the focal length that the images suggest, or by which an estimated one was changed, and its standard
  // deviation.
  double focal_factor = 1;
  double focal_factor_stddev = 0;
  std::string contradiction;  // one sentence; empty unless something is contradicted
  IntrinsicsCovariance covariance = IntrinsicsCovariance::Zero();  // JOINT only
};

// The most probable other explanation of the images with a pose.
struct RunnerUp {
  std::string explanation;  // explanation, should this pose be the right one
  Rigid3d cam_from_world;
  double odds = 0;  // over the result's pose
};

struct LocalizationResult {
  std::string query_name;
  QueryStatus status = QueryStatus::NO_PAIRS;
  bool is_camera_refined = false;  // false if query_camera is the given one
  std::string reason;              // one sentence; empty when LOCALIZED
  Camera query_camera;             // that belongs to the pose: as given, estimated or corrected
  IntrinsicsResult intrinsics;
  QueryPriorResult priors;

  std::string frame_name;  // of a rig's frame; empty for a single image
  // Median reprojection error, in an image of a rig, of the points triangulated from the database, before outliers are
  // removed. A large one means that the calibration is wrong.
  std::optional<double> rig_error_px;

  // Valid when LOCALIZED or LOW_CONFIDENCE.
  Rigid3d cam_from_world;
  Rigid3d rig_from_world;  // of the frame
  double rig_scale = 1;    // database units per unit of the frame's lengths
  // Covariance of cam_from_world in its tangent: rotation w (rad, R <- exp(w) R), then translation (database units).
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  PoseSpread spread;  // by the covariance
  // Probability that the position is right (uncertainty/confidence.h), and what it is computed from; nullopt if
  // unknown.
  std::optional<double> confidence;
  PoseEvidence evidence;
  std::optional<RunnerUp> runner_up;  // nullopt if nothing competes

  // Set if SCALE_UNOBSERVABLE, DEGENERATE_BASELINE or UNKNOWN_CAMERA leaves one orientation.
  std::optional<PartialPose> partial_pose;

  std::optional<DatabasePoseNoise> database_pose_noise;  // nullopt if nothing was refined
  std::optional<DepthResult> depth;                      // nullopt if no database image has a depth map
  std::string start;                                     // the hypothesis that refinement started from
  std::vector<PairResult> pairs;                         // every pair that was looked at, sorted by database_name
  std::vector<PointResult> points;
  int num_tracks = 0;        // tracks in the final adjustment
  int num_observations = 0;  // their image points, the query's included
  double mean_reprojection_error_px = 0;
  std::vector<std::pair<std::string, double>> seconds;  // stage, wall time; in order of execution
};

}  // namespace lazyloc
