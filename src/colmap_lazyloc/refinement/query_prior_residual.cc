#include "colmap_lazyloc/refinement/query_prior_residual.h"

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {

QueryPriorResidual EvaluatePositionPrior(const PositionPrior& prior, const Rigid3d& cam_from_frame,
                                         const Rigid3d& frame_from_world) {
  const Eigen::Matrix3d world_from_frame = frame_from_world.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d cam_in_frame = CamInWorld(cam_from_frame);
  const Eigen::Vector3d from_origin = cam_in_frame - frame_from_world.translation;  // C = R^T from_origin
  QueryPriorResidual residual;
  residual.error = world_from_frame * from_origin - prior.position;
  residual.jacobian << world_from_frame * Hat(from_origin), -world_from_frame, world_from_frame * cam_in_frame;
  const Eigen::LLT<Eigen::Matrix3d> factor(prior.covariance);
  factor.matrixL().solveInPlace(residual.error);
  factor.matrixL().solveInPlace(residual.jacobian);
  return residual;
}

QueryPriorResidual EvaluateGravityPrior(const GravityPrior& prior, const Rigid3d& cam_from_frame,
                                        const Rigid3d& frame_from_world) {
  const Eigen::Vector3d measured_in_frame = cam_from_frame.rotation.conjugate() * prior.down_in_cam;
  const Eigen::Vector3d down_in_frame = frame_from_world.rotation * prior.down_in_world;
  QueryPriorResidual residual;
  residual.error = measured_in_frame.cross(down_in_frame) / prior.stddev_rad;
  residual.jacobian.setZero();
  residual.jacobian.leftCols<3>() = -Hat(measured_in_frame) * Hat(down_in_frame) / prior.stddev_rad;
  return residual;
}

}  // namespace lazyloc
