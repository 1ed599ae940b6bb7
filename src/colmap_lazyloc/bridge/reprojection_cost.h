#pragma once

#include <array>
#include <type_traits>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <colmap/sensor/models.h>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// Projects a point in camera coordinates. Returns false if the model cannot: COLMAP 4 says so, COLMAP 3 returns
// nothing.
template <typename CameraModel, typename T>
bool Project(const T* params, const Eigen::Matrix<T, 3, 1>& point_in_cam, T* xy) {
  if (!(point_in_cam.z() > T(0))) return false;
  const auto project = [&] {
    return CameraModel::ImgFromCam(params, point_in_cam.x(), point_in_cam.y(), point_in_cam.z(), &xy[0], &xy[1]);
  };
  if constexpr (std::is_void_v<decltype(project())>) {
    project();
    return true;
  } else {
    return project();
  }
}

// Transforms a point into camera coordinates by the pose of a photo, a quaternion x y z w and a translation. Sets the
// derivatives that are wanted.
struct PhotoPlacement {
  static constexpr int kSize = 7;
  using ByPose = Eigen::Matrix<double, 3, kSize>;

  Eigen::Vector3d operator()(const double* cam_from_world, const Eigen::Vector3d& point, ByPose* by_pose,
                             Eigen::Matrix3d* by_point) const {
    const Eigen::Quaterniond rotation(cam_from_world);
    const Eigen::Vector3d axis = rotation.vec();
    if (by_pose != nullptr) {
      // The point turned is p + 2 w u x p + 2 u x (u x p).
      by_pose->leftCols<3>() =
          2 * (axis * point.transpose() - 2 * point * axis.transpose() - rotation.w() * Hat(point));
      by_pose->leftCols<3>().diagonal().array() += 2 * axis.dot(point);
      by_pose->col(3) = 2 * axis.cross(point);
      by_pose->rightCols<3>().setIdentity();
    }
    if (by_point != nullptr) *by_point = rotation.toRotationMatrix();
    return rotation * point + Eigen::Map<const Eigen::Vector3d>(cam_from_world + 4);
  }
};

// Does the same by the deviation of a database image from its prior: a rotation and a displacement in standard
// deviations.
struct DatabasePlacement {
  static constexpr int kSize = 6;
  using ByPose = Eigen::Matrix<double, 3, kSize>;

  PosePrior prior;

  Eigen::Vector3d operator()(const double* deviation, const Eigen::Vector3d& point, ByPose* by_pose,
                             Eigen::Matrix3d* by_point) const {
    using Jet = ceres::Jet<double, 3>;
    const Eigen::Map<const Eigen::Vector3d> turn(deviation), displacement(deviation + 3);
    const Eigen::Vector3d offset = point - CamInWorld(prior.frame_from_world) - displacement * prior.position_stddev;
    std::array<Jet, 3> angle_axis, jet_offset, turned;
    for (int k = 0; k < 3; ++k) {
      angle_axis[k] = Jet(turn[k], k) * prior.rotation_stddev_rad;
      jet_offset[k] = Jet(offset[k]);
    }
    ceres::AngleAxisRotatePoint(angle_axis.data(), jet_offset.data(), turned.data());
    const Eigen::Matrix3d rotation = prior.frame_from_world.rotation.toRotationMatrix();
    const Eigen::Matrix3d cam_from_offset = rotation * ExpSO3(prior.rotation_stddev_rad * turn).toRotationMatrix();
    if (by_pose != nullptr) {
      for (int k = 0; k < 3; ++k) by_pose->row(k).head<3>() = turned[k].v;
      by_pose->leftCols<3>() = rotation * by_pose->leftCols<3>();
      by_pose->rightCols<3>() = -prior.position_stddev * cam_from_offset;
    }
    if (by_point != nullptr) *by_point = cam_from_offset;
    return rotation * Eigen::Vector3d(turned[0].a, turned[1].a, turned[2].a);
  }
};

// The reprojection error of a point, in standard deviations. Derivatives of the projection are automatic; those by pose
// and point follow from them by the chain rule, which takes less than half the time of automatic ones.
template <typename CameraModel, typename Placement>
class ReprojectionCost : public ceres::SizedCostFunction<2, Placement::kSize, 3, CameraModel::num_params> {
 public:
  ReprojectionCost(Eigen::Vector2d keypoint, double stddev_px, Placement placement)
      : keypoint_(std::move(keypoint)), stddev_px_(stddev_px), placement_(std::move(placement)) {}

  bool Evaluate(const double* const* blocks, double* errors, double** jacobians) const override {
    constexpr int kNumParams = CameraModel::num_params;
    const Eigen::Vector3d point(blocks[1]);
    const double* params = blocks[2];
    Eigen::Map<Eigen::Vector2d> error(errors);
    if (jacobians == nullptr) {
      Eigen::Vector2d xy;
      if (!Project<CameraModel>(params, placement_(blocks[0], point, nullptr, nullptr), xy.data())) return false;
      error = (xy - keypoint_) / stddev_px_;
      return true;
    }
    typename Placement::ByPose by_pose;
    Eigen::Matrix3d by_point;
    const Eigen::Vector3d point_in_cam = placement_(blocks[0], point, &by_pose, &by_point);
    using Jet = ceres::Jet<double, 3 + kNumParams>;
    Eigen::Matrix<Jet, 3, 1> jet_point;
    std::array<Jet, kNumParams> jet_params;
    std::array<Jet, 2> xy;
    for (int k = 0; k < 3; ++k) jet_point[k] = Jet(point_in_cam[k], k);
    for (int k = 0; k < kNumParams; ++k) jet_params[k] = Jet(params[k], 3 + k);
    if (!Project<CameraModel>(jet_params.data(), jet_point, xy.data())) return false;  // Ceres rejects the step
    Eigen::Matrix<double, 2, 3 + kNumParams> derivatives;
    for (int k = 0; k < 2; ++k) {
      errors[k] = (xy[k].a - keypoint_[k]) / stddev_px_;
      derivatives.row(k) = xy[k].v / stddev_px_;
    }
    const Eigen::Matrix<double, 2, 3> by_point_in_cam = derivatives.template leftCols<3>();
    SetJacobian<Placement::kSize>(by_point_in_cam * by_pose, jacobians[0]);
    SetJacobian<3>(by_point_in_cam * by_point, jacobians[1]);
    SetJacobian<kNumParams>(derivatives.template rightCols<kNumParams>(), jacobians[2]);
    return true;
  }

 private:
  // Writes a Jacobian if it is wanted.
  template <int kSize>
  static void SetJacobian(const Eigen::Matrix<double, 2, kSize>& values, double* jacobian) {
    if (jacobian != nullptr) Eigen::Map<Eigen::Matrix<double, 2, kSize, Eigen::RowMajor>>{jacobian} = values;
  }

  Eigen::Vector2d keypoint_;
  double stddev_px_;
  Placement placement_;
};

// Returns the cost of an observation; null for a camera model that COLMAP does not know.
template <typename Placement>
ceres::CostFunction* MakeReprojectionCost(int model_id, const Eigen::Vector2d& keypoint, double stddev_px,
                                          Placement placement) {
  switch (static_cast<colmap::CameraModelId>(model_id)) {
#define CAMERA_MODEL_CASE(Model) \
  case colmap::Model::model_id:  \
    return new ReprojectionCost<colmap::Model, Placement>(keypoint, stddev_px, std::move(placement));
    CAMERA_MODEL_SWITCH_CASES
#undef CAMERA_MODEL_CASE
  }
  return nullptr;
}

}  // namespace lazyloc
