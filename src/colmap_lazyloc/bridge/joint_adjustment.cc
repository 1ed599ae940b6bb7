#include "colmap_lazyloc/bridge/joint_adjustment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <ceres/ceres.h>
#include <colmap/sensor/models.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Pose = std::array<double, 7>;  // quaternion x y z w, translation
using SparseMatrix = Eigen::SparseMatrix<double>;

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

// Computes the reprojection error in standard deviations.
template <typename CameraModel>
struct ReprojectionCost {
  Eigen::Vector2d keypoint;
  double stddev_px;

  template <typename T>
  bool operator()(const T* cam_from_world, const T* point_in_world, const T* params, T* error) const {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(cam_from_world);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> translation(cam_from_world + 4), point(point_in_world);
    const Eigen::Matrix<T, 3, 1> point_in_cam = rotation * point + translation;
    if (!Project<CameraModel>(params, point_in_cam, error)) return false;  // makes Ceres reject the step
    error[0] = (error[0] - keypoint.x()) / stddev_px;
    error[1] = (error[1] - keypoint.y()) / stddev_px;
    return true;
  }
};

ceres::CostFunction* MakeCost(int model_id, const Eigen::Vector2d& keypoint, double stddev_px) {
  switch (static_cast<colmap::CameraModelId>(model_id)) {
#define CAMERA_MODEL_CASE(Model)                                                                                 \
  case colmap::Model::model_id:                                                                                  \
    return new ceres::AutoDiffCostFunction<ReprojectionCost<colmap::Model>, 2, 7, 3, colmap::Model::num_params>( \
        new ReprojectionCost<colmap::Model>{keypoint, stddev_px});
    CAMERA_MODEL_SWITCH_CASES
#undef CAMERA_MODEL_CASE
  }
  return nullptr;
}

Pose ToArray(const Rigid3d& pose) {
  const Eigen::Vector4d q = pose.rotation.normalized().coeffs();
  return {q[0], q[1], q[2], q[3], pose.translation[0], pose.translation[1], pose.translation[2]};
}

Rigid3d FromArray(const Pose& pose) {
  return {Eigen::Quaterniond(pose.data()).normalized(), Eigen::Vector3d(pose[4], pose[5], pose[6])};
}

// Sets which parameters of a camera stay: the principal point and, if wanted, the distortion.
void FixParams(const JointCamera& camera, double* params, ceres::Problem* problem) {
  if (camera.is_constant) {
    problem->SetParameterBlockConstant(params);
    return;
  }
  const colmap::Camera converted = ToColmap(camera.camera);
  std::vector<int> constant;
  for (const size_t index : converted.PrincipalPointIdxs()) constant.push_back(static_cast<int>(index));
  if (!camera.refines_distortion) {
    for (const size_t index : converted.ExtraParamsIdxs()) constant.push_back(static_cast<int>(index));
  }
  if (constant.empty()) return;
  problem->SetManifold(params, new ceres::SubsetManifold(static_cast<int>(converted.params.size()), constant));
}

class JointSolver {
 public:
  explicit JointSolver(JointScene* scene) : scene_(*scene) {
    poses_.reserve(scene_.images.size());
    for (const JointImage& image : scene_.images) poses_.push_back(ToArray(image.cam_from_world));
    for (const JointCamera& camera : scene_.cameras) params_.push_back(camera.camera.params);
    for (const JointPoint& point : scene_.points) points_.push_back(point.point_in_world);
    for (size_t i = 0; i < scene_.points.size(); ++i) AddPoint(i);
    for (size_t i = 0; i < poses_.size(); ++i) {
      double* pose = poses_[i].data();
      if (!problem_.HasParameterBlock(pose)) continue;
      problem_.SetManifold(pose,
                           new ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>);
      if (scene_.images[i].is_constant) problem_.SetParameterBlockConstant(pose);
    }
    for (size_t i = 0; i < params_.size(); ++i) {
      if (problem_.HasParameterBlock(params_[i].data())) FixParams(scene_.cameras[i], params_[i].data(), &problem_);
    }
  }

  JointAdjustment Solve(bool computes_covariances) {
    JointAdjustment adjustment;
    if (points_.empty()) return adjustment;
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-7;
    options.parameter_tolerance = 1e-12;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    adjustment.summary = {summary.IsSolutionUsable(), summary.message,
                          summary.num_successful_steps + summary.num_unsuccessful_steps, summary.final_cost};
    if (!adjustment.summary.success) return adjustment;
    if (computes_covariances) AddCovariances(&adjustment);
    WriteScene();
    return adjustment;
  }

 private:
  void AddPoint(size_t index) {
    for (const JointObservation& observation : scene_.points[index].observations) {
      const JointImage& image = scene_.images[observation.image];
      problem_.AddResidualBlock(
          MakeCost(scene_.cameras[image.camera].camera.model_id, image.keypoints[observation.keypoint], image.noise_px),
          new ceres::CauchyLoss(kLossScaleSigma), poses_[observation.image].data(), points_[index].data(),
          params_[image.camera].data());
    }
  }

  bool IsVariable(const double* block) const {
    return problem_.HasParameterBlock(block) && !problem_.IsParameterBlockConstant(block);
  }

  void WriteScene() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (IsVariable(poses_[i].data())) scene_.images[i].cam_from_world = FromArray(poses_[i]);
    }
    for (size_t i = 0; i < params_.size(); ++i) {
      if (IsVariable(params_[i].data())) scene_.cameras[i].camera.params = params_[i];
    }
    for (size_t i = 0; i < points_.size(); ++i) scene_.points[i].point_in_world = points_[i];
  }

  // Eliminates the points from the normal equations of poses and cameras, and inverts what is left.
  void AddCovariances(JointAdjustment* adjustment) {
    ceres::Problem::EvaluateOptions options;
    std::vector<int> column_of_image(poses_.size(), -1);
    int num_columns = 0;
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!IsVariable(poses_[i].data())) continue;
      column_of_image[i] = num_columns;
      num_columns += 6;
      options.parameter_blocks.push_back(poses_[i].data());
    }
    for (std::vector<double>& params : params_) {
      if (!IsVariable(params.data())) continue;
      num_columns += problem_.ParameterBlockTangentSize(params.data());
      options.parameter_blocks.push_back(params.data());
    }
    for (Eigen::Vector3d& point : points_) options.parameter_blocks.push_back(point.data());
    ceres::CRSMatrix crs;
    std::vector<double> residuals;
    options.apply_loss_function = false;
    problem_.Evaluate(options, nullptr, &residuals, nullptr, &crs);
    adjustment->variance_factor = ApplyLoss(residuals, &crs);
    const Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>> jacobian(
        crs.num_rows, crs.num_cols, static_cast<int>(crs.values.size()), crs.rows.data(), crs.cols.data(),
        crs.values.data());
    const Eigen::SimplicialLDLT<SparseMatrix> factors(ReducedSystem(jacobian, num_columns));
    for (size_t i = 0; i < poses_.size(); ++i) {
      adjustment->covariances.push_back(
          column_of_image[i] < 0 ? Matrix6d(Matrix6d::Constant(scene_.images[i].is_constant ? 0 : kUnknown))
                                 : adjustment->variance_factor * Covariance(factors, column_of_image[i], num_columns));
    }
  }

  // Multiplies the rows of each observation by the root of its weight in Cauchy's loss. Returns the factor on the
  // inverse of the normal equations that makes it the covariance of the M-estimator (Huber, 1964).
  static double ApplyLoss(const std::vector<double>& residuals, ceres::CRSMatrix* jacobian) {
    double sum_weights = 0, sum_derivatives = 0, sum_squares = 0;
    for (size_t row = 0; row + 1 < residuals.size(); row += 2) {
      const double square = residuals[row] * residuals[row] + residuals[row + 1] * residuals[row + 1];
      const double weight = 1 / (1 + square / (kLossScaleSigma * kLossScaleSigma));
      sum_weights += weight;
      sum_derivatives += weight * weight;
      sum_squares += weight * weight * square / 2;
      for (int i = jacobian->rows[row]; i < jacobian->rows[row + 2]; ++i) jacobian->values[i] *= std::sqrt(weight);
    }
    const double degrees_of_freedom = std::max(jacobian->num_rows - jacobian->num_cols, 1);
    return sum_squares * sum_weights / (sum_derivatives * sum_derivatives) * jacobian->num_rows / degrees_of_freedom;
  }

  static SparseMatrix ReducedSystem(const SparseMatrix& jacobian, int num_columns) {
    const SparseMatrix of_cameras = jacobian.leftCols(num_columns);
    const SparseMatrix of_points = jacobian.rightCols(jacobian.cols() - num_columns);
    SparseMatrix inverse = of_points.transpose() * of_points;  // blocks of three columns on the diagonal
    inverse.makeCompressed();
    std::vector<Eigen::Triplet<double>> elements;
    for (int begin = 0; begin < inverse.cols(); begin += 3) {
      Eigen::Matrix3d block = Eigen::Matrix3d::Zero();
      for (int col = 0; col < 3; ++col) {
        for (SparseMatrix::InnerIterator element(inverse, begin + col); element; ++element) {
          block(element.row() - begin, col) = element.value();
        }
      }
      // Keeps a point at infinity from making the inverse infinite.
      block.diagonal().array() += 1e-12 * block.trace() + std::numeric_limits<double>::min();
      const Eigen::Matrix3d inverse_block = block.inverse();
      for (int row = 0; row < 3; ++row) {
        for (int col = 0; col < 3; ++col) elements.emplace_back(begin + row, begin + col, inverse_block(row, col));
      }
    }
    inverse.setFromTriplets(elements.begin(), elements.end());
    const SparseMatrix coupling = of_cameras.transpose() * of_points;
    const SparseMatrix reduction = coupling * inverse;
    return SparseMatrix(of_cameras.transpose() * of_cameras) - SparseMatrix(reduction * coupling.transpose());
  }

  static Matrix6d Covariance(const Eigen::SimplicialLDLT<SparseMatrix>& factors, int column, int num_columns) {
    if (factors.info() != Eigen::Success) return Matrix6d::Constant(kUnknown);
    Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(num_columns, 6);
    unit.middleRows<6>(column).setIdentity();
    Matrix6d covariance = Eigen::MatrixXd(factors.solve(unit)).middleRows<6>(column);
    covariance = (covariance + covariance.transpose()).eval() / 2;
    if (!(covariance.diagonal().minCoeff() > 0)) return Matrix6d::Constant(kUnknown);
    covariance.topRows<3>() *= 2;  // because Ceres' tangent of a quaternion is half the angle
    covariance.leftCols<3>() *= 2;
    return covariance;
  }

  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  JointScene& scene_;
  std::vector<Pose> poses_;                  // by image
  std::vector<std::vector<double>> params_;  // by camera
  std::vector<Eigen::Vector3d> points_;
  ceres::Problem problem_;
};

}  // namespace

JointAdjustment AdjustJointly(bool computes_covariances, JointScene* scene) {
  return JointSolver(scene).Solve(computes_covariances);
}

double ReprojectionErrorPx(const JointScene& scene, const JointPoint& point, const JointObservation& observation) {
  const JointImage& image = scene.images[observation.image];
  const std::optional<Eigen::Vector2d> xy =
      ImageFromCam(scene.cameras[image.camera].camera, image.cam_from_world * point.point_in_world);
  return xy ? (*xy - image.keypoints[observation.keypoint]).norm() : std::numeric_limits<double>::infinity();
}

}  // namespace lazyloc
