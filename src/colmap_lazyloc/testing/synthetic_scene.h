#pragma once

#include <random>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

enum class SceneLayout {
  RING,           // cameras around the points, looking inwards
  LINE,           // database cameras on a straight line, the query beside it
  LINE_ON_LINE,   // all cameras on a straight line, looking sideways
  FORWARD,        // all cameras on a straight line, looking along it
  PURE_ROTATION,  // all cameras at one place, with different rotations
  SAME_PLACE,     // the query at the place of the first database image, the others elsewhere
};

struct SyntheticSceneOptions {
  SceneLayout layout = SceneLayout::RING;
  int num_database_images = 10;
  int num_points = 200;
  bool has_planar_points = false;  // true: all points lie in an inclined plane
  double pixel_noise_px = 0;
  double rotation_noise_deg = 0;                     // error of each pair's relative rotation
  double direction_noise_deg = 0;                    // error of each pair's translation direction
  double outlier_pair_ratio = 0;                     // pairs with random relative pose and random matches
  double outlier_match_ratio = 0;                    // random matches among the inliers of the other pairs
  bool has_geometry = true;                          // false: pairs have only raw matches
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // centre of the scene, in database units
  double unit = 1;                                   // database units per scene unit (the scene spans about 10)
  uint32_t seed = 0;
};

struct SyntheticScene {
  LocalizationProblem problem;
  Rigid3d query_cam_from_world;  // true pose
  double median_depth = 0;       // of the points in the query image, in database units
  int num_outlier_pairs = 0;
};

// Makes one query and its database images, with exact or noisy matches of points that all images observe.
SyntheticScene MakeSyntheticScene(const SyntheticSceneOptions& options);

// Helpers for other synthetic data.
using Random = std::mt19937;
// Returns a vector with elements from the standard normal distribution.
Eigen::Vector3d RandomVector(Random* random);
// Returns a rotation from the uniform distribution.
Eigen::Quaterniond RandomRotation(Random* random);
// Return the rotation or direction rotated by exactly angle_deg about a random axis.
Eigen::Quaterniond Disturbed(const Eigen::Quaterniond& rotation, double angle_deg, Random* random);
Eigen::Vector3d DisturbedDirection(const Eigen::Vector3d& direction, double angle_deg, Random* random);
// Returns the pose of a camera (z forward, y down) that looks at a target.
Rigid3d LookAt(const Eigen::Vector3d& cam_in_world, const Eigen::Vector3d& target_in_world);

// Return the distance of the projection centres and the angle between the rotations of two poses.
double PositionError(const Rigid3d& a, const Rigid3d& b);
double RotationErrorDeg(const Rigid3d& a, const Rigid3d& b);

}  // namespace lazyloc
