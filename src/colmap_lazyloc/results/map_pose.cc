#include "colmap_lazyloc/results/map_pose.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

constexpr double kUnknownAngleStddevDeg = 103.92304845413264;  // of a uniform distribution, 360 / sqrt(12)
constexpr double kMinHorizontal = 1e-6;  // of a unit vector; below, rounding decides where it points on the ground

// Returns the rotation from the world's axes to east, north and up at a point.
Eigen::Matrix3d LevelFromWorld(const std::optional<GeodeticPoint>& origin, const Eigen::Vector3d& point_in_world) {
  if (!origin) return Eigen::Matrix3d::Identity();
  return EcefFromEnuRotation(GeodeticFromEnu(*origin, point_in_world)).transpose() * EcefFromEnuRotation(*origin);
}

double CompassDeg(const Eigen::Vector2d& dir) {
  const double deg = RadToDeg(std::atan2(dir.x(), dir.y()));
  const double positive = deg < 0 ? deg + 360 : deg + 0.0;  // not -0
  return positive < 360 ? positive : 0;
}

// Returns an angle by its derivative by the turn. That of north by the position is left out: 1e-5 degrees for a metre.
CameraAngle MakeAngle(double deg, const Eigen::RowVector3d& derivative,
                      const std::optional<Eigen::Matrix3d>& turn_covariance) {
  if (!turn_covariance) return {deg, std::nullopt};
  const double variance = std::max(0.0, (derivative * *turn_covariance).dot(derivative));
  return {deg, std::min(RadToDeg(std::sqrt(variance)), kUnknownAngleStddevDeg)};
}

// The part of a unit vector along the ground.
struct Horizontal {
  Eigen::Vector2d dir;  // unit length
  double length = 1;    // at least kMinHorizontal
};

// fallback: direction of a vector that is vertical but for rounding.
Horizontal HorizontalOf(const Eigen::Vector3d& vector, const Eigen::Vector2d& fallback) {
  const double length = vector.head<2>().norm();
  if (length < kMinHorizontal) return {fallback.normalized(), kMinHorizontal};
  return {vector.head<2>() / length, length};
}

// A turn p about the level axes, level_from_cam <- exp(p) level_from_cam, moves a unit vector v of the camera by p x v.
// The azimuth atan2(v_x, v_y) changes by (v_y dv_x - v_x dv_y) / c^2 with c^2 = v_x^2 + v_y^2, which is
// v_z (p_x v_x + p_y v_y) / c^2 - p_z.
CameraAngle Azimuth(const Horizontal& v, double v_z, const std::optional<Eigen::Matrix3d>& turn_covariance) {
  const double tilt = v_z / v.length;
  return MakeAngle(CompassDeg(v.dir), {tilt * v.dir.x(), tilt * v.dir.y(), -1}, turn_covariance);
}

// Rz(-heading) Rx(pitch) Ry(roll) turns by -d(heading) about the vertical, by d(pitch) about the horizontal axis to the
// right of the optical axis f, and by d(roll) about f. The turn p is their sum. Along that horizontal axis it is
// d(pitch); along the horizontal direction of f it is d(roll) times the length of f there.
CameraAngles AnglesOf(const Eigen::Matrix3d& level_from_cam, const std::optional<Eigen::Matrix3d>& turn_covariance) {
  const Eigen::Vector3d right = level_from_cam.col(0), top = -level_from_cam.col(1), f = level_from_cam.col(2);
  // Where f or the top is vertical, what is ahead of the right side takes its place.
  const Eigen::Vector2d ahead(-right.y(), right.x());
  const Horizontal axis = HorizontalOf(f, ahead);
  const bool is_vertical = axis.length == kMinHorizontal;
  const double roll_rad = is_vertical ? 0 : std::atan2(-right.z(), top.z());
  CameraAngles angles;
  angles.heading = Azimuth(axis, f.z(), turn_covariance);
  angles.pitch =
      MakeAngle(RadToDeg(std::atan2(f.z(), f.head<2>().norm())), {axis.dir.y(), -axis.dir.x(), 0}, turn_covariance);
  angles.roll =
      MakeAngle(RadToDeg(roll_rad), {axis.dir.x() / axis.length, axis.dir.y() / axis.length, 0}, turn_covariance);
  angles.top_heading = Azimuth(HorizontalOf(top, ahead), top.z(), turn_covariance);
  return angles;
}

}  // namespace

MapPose MakeMapPose(const LocalizationResult& result, const WorldAxes& axes) {
  MapPose pose;
  pose.world_from_cam = Inverse(result.cam_from_world);
  if (result.covariance.allFinite()) {
    pose.covariance = MakePoseDistribution(result.cam_from_world, result.covariance).CovarianceInWorld();
  }
  if (axes.are_arbitrary) return pose;
  const Eigen::Matrix3d level_from_world = LevelFromWorld(axes.geographic_origin, pose.world_from_cam.translation);
  std::optional<Eigen::Matrix3d> turn_covariance;
  if (pose.covariance) {
    turn_covariance = level_from_world * pose.covariance->bottomRightCorner<3, 3>() * level_from_world.transpose();
  }
  pose.angles = AnglesOf(level_from_world * pose.world_from_cam.rotation.toRotationMatrix(), turn_covariance);
  return pose;
}

}  // namespace lazyloc
