#include "colmap_lazyloc/refinement/sampson_refinement.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/epipolar_error.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// A match between a database image, in the world, and a query, in the axes of its camera.
struct DatabaseMatch {
  RayMatch rays;
  Eigen::Vector3d database_in_world;
};

std::vector<DatabaseMatch> MatchesOf(int query, const std::vector<Track>& tracks, const PosedImages& posed) {
  std::vector<DatabaseMatch> matches;
  for (const Track& track : tracks) {
    const auto own = std::find_if(track.observations.begin(), track.observations.end(),
                                  [query](const TrackObservation& element) { return element.image == query; });
    if (own == track.observations.end()) continue;
    for (const TrackObservation& other : track.observations) {
      if (!posed.IsDatabase(other.image)) continue;
      const Rigid3d database_from_world = CamFromWorld(posed, other.image);
      RayMatch rays = MakeRayMatch(database_from_world.rotation.conjugate().toRotationMatrix(), other.observation,
                                   Eigen::Matrix3d::Identity(), own->observation);
      rays.stddev1_rad *= track.noise_ratio * posed.images[other.image].noise_px;
      rays.stddev2_rad *= track.noise_ratio * posed.images[query].noise_px;
      matches.push_back({rays, CamInWorld(database_from_world)});
    }
  }
  return matches;
}

struct Pose {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Vector3d cam_in_world;
};

struct NormalEquations {
  double cost = 0;
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
};

NormalEquations Linearize(const std::vector<DatabaseMatch>& matches, const Pose& pose) {
  NormalEquations equations;
  const Eigen::Matrix3d world_from_cam = pose.cam_from_world_rotation.conjugate().toRotationMatrix();
  Eigen::Matrix<double, 1, 6> jacobian;
  for (const DatabaseMatch& match : matches) {
    RayMatch in_world = match.rays;
    in_world.ray2 = world_from_cam * match.rays.ray2;
    const double error = SampsonError(in_world, pose.cam_in_world - match.database_in_world, &jacobian);
    jacobian.head<3>() *= world_from_cam;  // turns of the tangent are in the camera's axes
    const double in_scale = error * error / (kLossScaleSigma * kLossScaleSigma), weight = 1 / (1 + in_scale);
    equations.cost += 0.5 * kLossScaleSigma * kLossScaleSigma * std::log1p(in_scale);
    equations.hessian.noalias() += weight * jacobian.transpose() * jacobian;
    equations.gradient.noalias() += weight * error * jacobian.transpose();
  }
  return equations;
}

Pose Moved(const Pose& pose, const NormalEquations& equations, double damping) {
  Matrix6d damped = equations.hessian;
  damped.diagonal() *= 1 + damping;
  // Keeps a position that is unobservable along a line where it started.
  damped.diagonal().tail<3>().array() += 1e-9 * equations.hessian.diagonal().tail<3>().maxCoeff();
  const Vector6d step = damped.ldlt().solve(-equations.gradient);
  return {(ExpSO3(step.head<3>()) * pose.cam_from_world_rotation).normalized(), pose.cam_in_world + step.tail<3>()};
}

// Minimises by Levenberg-Marquardt. Returns false if the cost is not finite.
bool Minimize(double function_tolerance, const std::vector<DatabaseMatch>& matches, Pose* pose) {
  constexpr int kMaxNumIterations = 50;
  NormalEquations current = Linearize(matches, *pose);
  if (!std::isfinite(current.cost)) return false;
  double damping = 1e-4;
  for (int i = 0; i < kMaxNumIterations && damping <= 1e8; ++i) {
    const Pose next_pose = Moved(*pose, current, damping);
    const NormalEquations next = Linearize(matches, next_pose);
    if (!(next.cost < current.cost)) {
      damping *= 10;
      continue;
    }
    const double relative_decrease = (current.cost - next.cost) / current.cost;
    *pose = next_pose;
    current = next;
    damping = std::max(damping / 10, 1e-12);
    if (relative_decrease < function_tolerance) break;
  }
  return true;
}

}  // namespace

PoseRefinementResult RefineBySampsonError(const PosedImages& posed, const std::vector<Track>& tracks,
                                          double function_tolerance) {
  PoseRefinementResult result = {{true, "refined", 0, 0}, posed};
  const auto fail = [&](const char* message) { return PoseRefinementResult{{false, message, 0, 0}, posed}; };
  for (int image = 0; image < static_cast<int>(posed.images.size()); ++image) {
    if (posed.IsDatabase(image)) continue;
    const std::vector<DatabaseMatch> matches = MatchesOf(image, tracks, posed);
    if (matches.size() < Vector6d::SizeAtCompileTime) return fail("a query has less than six matches");
    Rigid3d& frame_from_world = result.posed.frames[posed.images[image].frame].frame_from_world;
    Pose pose = {frame_from_world.rotation, CamInWorld(frame_from_world)};
    if (!Minimize(function_tolerance, matches, &pose)) return fail("the cost is not finite");
    frame_from_world = CamFromWorld(pose.cam_from_world_rotation, pose.cam_in_world);
  }
  return result;
}

}  // namespace lazyloc
