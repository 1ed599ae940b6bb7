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
  LINE_ON_LINE,   // the same, the query on the line too
  FORWARD,        // the same line, all looking along it
  PURE_ROTATION,  // every camera at one place, turned
  SAME_PLACE,     // the query at the place of its first database image, the others apart
};

struct SyntheticSceneOptions {
  SceneLayout layout = SceneLayout::RING;
  int num_database_images = 10;
  int num_points = 200;
  bool has_planar_points = false;  // all in an inclined square
  double pixel_noise_px = 0;
  double rotation_noise_deg = 0;                     // of each pair's relative rotation
  double direction_noise_deg = 0;                    // of each pair's relative translation
  double outlier_pair_ratio = 0;                     // gross: random relative pose, random matches
  double outlier_match_ratio = 0;                    // within good pairs: random matches among the inliers
  bool has_geometry = true;                          // else only raw matches
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // where the scene lies
  double unit = 1;                                   // database units per scene unit (the scene spans about 10)
  uint32_t seed = 0;
};

struct SyntheticScene {
  LocalizationProblem problem;
  Rigid3d query_cam_from_world;  // truth
  double median_depth = 0;       // of the points in the query, in database units
  int num_outlier_pairs = 0;
};

// One query and its database images, with exact or noisy matches of points that all of them see.
SyntheticScene MakeSyntheticScene(const SyntheticSceneOptions& options);

// Helpers for other synthetic data.
using Random = std::mt19937;
Eigen::Vector3d RandomVector(Random* random);       // standard normal
Eigen::Quaterniond RandomRotation(Random* random);  // uniform
// Turned by exactly angle_deg about a random axis.
Eigen::Quaterniond Disturbed(const Eigen::Quaterniond& rotation, double angle_deg, Random* random);
Eigen::Vector3d DisturbedDirection(const Eigen::Vector3d& direction, double angle_deg, Random* random);
// COLMAP's camera frame (z forward, y down) at a place, looking at another.
Rigid3d LookAt(const Eigen::Vector3d& cam_in_world, const Eigen::Vector3d& target_in_world);

// Distance of projection centres, and angle, between two poses.
double PositionError(const Rigid3d& a, const Rigid3d& b);
double RotationErrorDeg(const Rigid3d& a, const Rigid3d& b);

}  // namespace lazyloc
