#include "colmap_lazyloc/bridge/joint_adjustment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include <Eigen/Geometry>
#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/reprojection_cost.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

using Pose = std::array<double, 7>;       // quaternion x y z w, translation
using Deviation = std::array<double, 6>;  // of a database image from its prior
using SparseMatrix = Eigen::SparseMatrix<double>;
using RowMajorMatrix = Eigen::SparseMatrix<double, Eigen::RowMajor>;

// The errors of one coordinate of deviations: rows of the root of their precision times them.
class PriorCost : public ceres::CostFunction {
 public:
  PriorCost(int coordinate, Eigen::MatrixXd root) : coordinate_(coordinate), root_(std::move(root)) {
    set_num_residuals(static_cast<int>(root_.rows()));
    mutable_parameter_block_sizes()->assign(root_.cols(), 6);
  }

  bool Evaluate(const double* const* deviations, double* errors, double** jacobians) const override {
    Eigen::VectorXd values(root_.cols());
    for (Eigen::Index i = 0; i < values.size(); ++i) values[i] = deviations[i][coordinate_];
    Eigen::Map<Eigen::VectorXd>(errors, root_.rows()) = root_ * values;
    for (Eigen::Index i = 0; jacobians != nullptr && i < values.size(); ++i) {
      if (jacobians[i] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>> jacobian(jacobians[i], root_.rows(), 6);
      jacobian.setZero();
      jacobian.col(coordinate_) = root_.col(i);
    }
    return true;
  }

 private:
  int coordinate_;
  Eigen::MatrixXd root_;
};

Pose ToArray(const Rigid3d& pose) {
  const Eigen::Vector4d q = pose.rotation.normalized().coeffs();
  return {q[0], q[1], q[2], q[3], pose.translation[0], pose.translation[1], pose.translation[2]};
}

Rigid3d FromArray(const Pose& pose) {
  return {Eigen::Quaterniond(pose.data()).normalized(), Eigen::Vector3d(pose[4], pose[5], pose[6])};
}

// Sets which parameters of a camera stay: at least the principal point.
void FixParams(const JointCamera& camera, double* params, ceres::Problem* problem) {
  if (camera.is_constant) {
    problem->SetParameterBlockConstant(params);
    return;
  }
  const colmap::Camera converted = ToColmap(camera.camera);
  const auto principal_point = converted.PrincipalPointIdxs();
  const std::vector<int> constant(principal_point.begin(), principal_point.end());
  problem->SetManifold(params, new ceres::SubsetManifold(static_cast<int>(converted.params.size()), constant));
}

// The following two measure deviations as EvaluatePosePrior does.

Deviation DeviationOf(const PosePrior& prior, const Rigid3d& pose) {
  const Eigen::Vector3d turn = LogSO3(prior.frame_from_world.rotation.conjugate() * pose.rotation);
  const Eigen::Vector3d displacement = CamInWorld(pose) - CamInWorld(prior.frame_from_world);
  Deviation deviation;
  Eigen::Map<Eigen::Vector3d>(deviation.data()) = turn / prior.rotation_stddev_rad;
  Eigen::Map<Eigen::Vector3d>(deviation.data() + 3) = displacement / prior.position_stddev;
  return deviation;
}

Rigid3d PoseAt(const PosePrior& prior, const Deviation& deviation) {
  const Eigen::Map<const Eigen::Vector3d> turn(deviation.data()), displacement(deviation.data() + 3);
  const Eigen::Quaterniond rotation = prior.frame_from_world.rotation * ExpSO3(prior.rotation_stddev_rad * turn);
  return CamFromWorld(rotation.normalized(), CamInWorld(prior.frame_from_world) + prior.position_stddev * displacement);
}

class JointSolver {
 public:
  JointSolver(bool adjusts_only_points, JointScene* scene)
      : scene_(*scene), deviations_(scene->images.size(), Deviation()) {
    poses_.reserve(scene_.images.size());
    for (size_t i = 0; i < scene_.images.size(); ++i) {
      const JointImage& image = scene_.images[i];
      poses_.push_back(ToArray(image.cam_from_world));
      if (image.prior) deviations_[i] = DeviationOf(*image.prior, image.cam_from_world);
    }
    for (const JointCamera& camera : scene_.cameras) params_.push_back(camera.camera.params);
    for (const JointPoint& point : scene_.points) points_.push_back(point.point_in_world);
    for (size_t i = 0; i < scene_.points.size(); ++i) AddPoint(i);
    for (size_t i = 0; i < poses_.size(); ++i) {
      double* pose = poses_[i].data();
      if (!problem_.HasParameterBlock(pose)) continue;
      problem_.SetManifold(pose,
                           new ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>);
      if (scene_.images[i].is_database) problem_.SetParameterBlockConstant(pose);
    }
    for (size_t i = 0; i < params_.size(); ++i) {
      if (problem_.HasParameterBlock(params_[i].data())) FixParams(scene_.cameras[i], params_[i].data(), &problem_);
    }
    if (adjusts_only_points) {
      FixAllButPoints();
    } else {
      AddPriors();
    }
    AddSurveys();
  }

  JointAdjustment Solve(const JointAdjustmentOptions& options) {
    JointAdjustment adjustment;
    if (points_.empty()) return adjustment;
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.max_num_iterations = options.max_num_iterations;
    solver.function_tolerance = options.min_cost_change_ratio;
    solver.parameter_tolerance = 1e-12;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    adjustment.summary = {summary.IsSolutionUsable(), summary.message,
                          summary.num_successful_steps + summary.num_unsuccessful_steps, summary.final_cost};
    if (!adjustment.summary.success) return adjustment;
    if (options.computes_information) AddInformation(&adjustment);
    WriteScene();
    return adjustment;
  }

 private:
  // Returns the standard deviation of a keypoint, or of a control point's mark.
  static double NoisePx(const JointPoint& point, const JointImage& image) {
    return point.survey ? point.survey->mark_noise_px : image.noise_px;
  }

  void AddPoint(size_t index) {
    for (const JointObservation& observation : scene_.points[index].observations) {
      const JointImage& image = scene_.images[observation.image];
      const int model_id = scene_.cameras[image.camera].camera.model_id;
      const Eigen::Vector2d& keypoint = image.keypoints[observation.keypoint];
      const double noise_px = NoisePx(scene_.points[index], image);
      problem_.AddResidualBlock(
          image.prior ? MakeReprojectionCost(model_id, keypoint, noise_px, DatabasePlacement{*image.prior})
                      : MakeReprojectionCost(model_id, keypoint, noise_px, PhotoPlacement{}),
          new ceres::CauchyLoss(kLossScaleSigma), PoseBlock(observation.image), points_[index].data(),
          params_[image.camera].data());
    }
  }

  void FixAllButPoints() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (problem_.HasParameterBlock(PoseBlock(i))) problem_.SetParameterBlockConstant(PoseBlock(i));
    }
    for (std::vector<double>& params : params_) {
      if (problem_.HasParameterBlock(params.data())) problem_.SetParameterBlockConstant(params.data());
    }
  }

  // Adds the priors behind all observations.
  void AddPriors() {
    std::vector<double*> deviations;
    for (size_t i = 0; i < deviations_.size(); ++i) {
      if (scene_.images[i].prior) deviations.push_back(deviations_[i].data());
    }
    for (int k = 0; k < 6 && !deviations.empty(); ++k) {
      const auto& root = k < 3 ? scene_.rotation_root : scene_.position_root;
      if (root.nonZeros() == root.rows() * (root.rows() + 1) / 2) {  // dense
        problem_.AddResidualBlock(new PriorCost(k, root), nullptr, deviations);
        continue;
      }
      for (Eigen::Index row = 0; row < root.rows(); ++row) {  // keeps the equations sparse
        std::vector<double*> own;
        std::vector<double> values;
        for (RowMajorMatrix::InnerIterator element(root, row); element; ++element) {
          own.push_back(deviations[element.col()]);
          values.push_back(element.value());
        }
        const Eigen::Map<Eigen::RowVectorXd> own_root(values.data(), static_cast<Eigen::Index>(values.size()));
        problem_.AddResidualBlock(new PriorCost(k, own_root), nullptr, own);
      }
    }
  }

  // Adds the surveys behind the priors.
  void AddSurveys() {
    for (size_t i = 0; i < points_.size(); ++i) {
      const std::optional<Survey>& survey = scene_.points[i].survey;
      if (!survey || !problem_.HasParameterBlock(points_[i].data())) continue;
      const Eigen::Matrix3d root_precision = survey->stddevs.cwiseInverse().asDiagonal();
      problem_.AddResidualBlock(new ceres::NormalPrior(root_precision, survey->place), nullptr, points_[i].data());
      num_survey_errors_ += 3;
    }
  }

  double* PoseBlock(size_t image) {
    return scene_.images[image].prior ? deviations_[image].data() : poses_[image].data();
  }

  bool IsVariable(const double* block) const {
    return problem_.HasParameterBlock(block) && !problem_.IsParameterBlockConstant(block);
  }

  void WriteScene() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!IsVariable(PoseBlock(i))) continue;
      JointImage& image = scene_.images[i];
      image.cam_from_world = image.prior ? PoseAt(*image.prior, deviations_[i]) : FromArray(poses_[i]);
    }
    for (size_t i = 0; i < params_.size(); ++i) {
      if (IsVariable(params_[i].data())) scene_.cameras[i].camera.params = params_[i];
    }
    for (size_t i = 0; i < points_.size(); ++i) scene_.points[i].point_in_world = points_[i];
  }

  // Eliminates the points from the normal equations of poses and cameras.
  void AddInformation(JointAdjustment* adjustment) {
    ceres::Problem::EvaluateOptions options;
    std::vector<double> scales;  // from the tangent of a parameter to Ceres' tangent
    for (size_t i = 0; i < poses_.size(); ++i) {
      const bool is_adjusted = IsVariable(PoseBlock(i));
      adjustment->first_parameter.push_back(is_adjusted ? static_cast<int>(scales.size()) : -1);
      if (!is_adjusted) continue;
      options.parameter_blocks.push_back(PoseBlock(i));
      scales.resize(scales.size() + 6, 1);
      // Ceres' tangent of a quaternion is half the angle.
      if (!scene_.images[i].prior) std::fill_n(scales.end() - 6, 3, 0.5);
    }
    for (std::vector<double>& params : params_) {
      if (!IsVariable(params.data())) continue;
      scales.resize(scales.size() + problem_.ParameterBlockTangentSize(params.data()), 1);
      options.parameter_blocks.push_back(params.data());
    }
    for (Eigen::Vector3d& point : points_) options.parameter_blocks.push_back(point.data());
    ceres::CRSMatrix crs;
    std::vector<double> residuals;
    options.apply_loss_function = false;
    problem_.Evaluate(options, nullptr, &residuals, nullptr, &crs);
    adjustment->variance_factor = ApplyLoss(residuals, &crs);
    const Eigen::Map<const RowMajorMatrix> jacobian(crs.num_rows, crs.num_cols, static_cast<int>(crs.values.size()),
                                                    crs.rows.data(), crs.cols.data(), crs.values.data());
    const auto scale = Eigen::Map<const Eigen::VectorXd>(scales.data(), static_cast<Eigen::Index>(scales.size()));
    const SparseMatrix of_poses = SparseMatrix(jacobian.leftCols(scale.size())) * scale.asDiagonal();
    const SparseMatrix of_points = jacobian.rightCols(jacobian.cols() - scale.size());
    const SparseMatrix inverse = InverseOfPoints(of_points);
    adjustment->information = Reduced(of_poses, of_poses, of_points, inverse);
    adjustment->coupling_with_cameras = Reduced(of_poses, DerivativeByCorrections(residuals), of_points, inverse);
  }

  // Returns the weight in Cauchy's loss of an observation, by the square of its error.
  static double Weight(double square) { return 1 / (1 + square / (kLossScaleSigma * kLossScaleSigma)); }

  // Returns the derivative of the weighted residuals with respect to corrections of the constant cameras' intrinsics.
  SparseMatrix DerivativeByCorrections(const std::vector<double>& residuals) const {
    std::vector<Eigen::Triplet<double>> elements;
    int row = 0;
    for (const JointPoint& point : scene_.points) {
      for (const JointObservation& observation : point.observations) {
        const JointImage& image = scene_.images[observation.image];
        const JointCamera& camera = scene_.cameras[image.camera];
        if (!camera.covariance.isZero(0)) {
          const double noise_px = NoisePx(point, image);
          const Eigen::Vector2d error(residuals[row], residuals[row + 1]);
          const Eigen::Vector2d projection = image.keypoints[observation.keypoint] + noise_px * error;
          const Eigen::Matrix<double, 2, NUM_INTRINSICS_PARAMETERS> derivative =
              std::sqrt(Weight(error.squaredNorm())) / noise_px *
              CorrectionDerivative(projection - PrincipalPoint(camera.camera));
          for (int k = 0; k < 2; ++k) {
            for (int col = 0; col < NUM_INTRINSICS_PARAMETERS; ++col) {
              elements.emplace_back(row + k, NUM_INTRINSICS_PARAMETERS * image.camera + col, derivative(k, col));
            }
          }
        }
        row += 2;
      }
    }
    SparseMatrix derivative(static_cast<Eigen::Index>(residuals.size()),
                            static_cast<Eigen::Index>(NUM_INTRINSICS_PARAMETERS * scene_.cameras.size()));
    derivative.setFromTriplets(elements.begin(), elements.end());
    return derivative;
  }

  // Multiplies the rows of each observation by the root of its weight in Cauchy's loss. Returns the variance factor.
  double ApplyLoss(const std::vector<double>& residuals, ceres::CRSMatrix* jacobian) const {
    const auto num_deviations = 6 * scene_.rotation_root.rows() + num_survey_errors_;
    const auto num_errors = static_cast<Eigen::Index>(residuals.size()) - num_deviations;
    double sum_weights = 0, sum_derivatives = 0, sum_squares = 0;
    for (Eigen::Index row = 0; row < num_errors; row += 2) {
      const double square = residuals[row] * residuals[row] + residuals[row + 1] * residuals[row + 1];
      const double weight = Weight(square);
      sum_weights += weight;
      sum_derivatives += weight * weight;
      sum_squares += weight * weight * square / 2;
      for (int i = jacobian->rows[row]; i < jacobian->rows[row + 2]; ++i) jacobian->values[i] *= std::sqrt(weight);
    }
    const auto degrees_of_freedom = std::max<double>(jacobian->num_rows - jacobian->num_cols, 1);
    return sum_squares * sum_weights / (sum_derivatives * sum_derivatives) * static_cast<double>(num_errors) /
           degrees_of_freedom;
  }

  // Returns the inverse of the points' part of the normal equations.
  static SparseMatrix InverseOfPoints(const SparseMatrix& of_points) {
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
    return inverse;
  }

  // Returns a part of the normal equations with the points eliminated, by the derivatives of the residuals.
  static SparseMatrix Reduced(const SparseMatrix& left, const SparseMatrix& right, const SparseMatrix& of_points,
                              const SparseMatrix& inverse_of_points) {
    const SparseMatrix reduction = SparseMatrix(left.transpose() * of_points) * inverse_of_points;
    return SparseMatrix(left.transpose() * right) -
           SparseMatrix(reduction * SparseMatrix(of_points.transpose() * right));
  }

  JointScene& scene_;
  std::vector<Pose> poses_;                  // by image
  std::vector<Deviation> deviations_;        // by image; of those with a prior
  std::vector<std::vector<double>> params_;  // by camera
  std::vector<Eigen::Vector3d> points_;
  Eigen::Index num_survey_errors_ = 0;
  ceres::Problem problem_;
};

}  // namespace

JointAdjustment AdjustJointly(const JointAdjustmentOptions& options, JointScene* scene) {
  return JointSolver(options.adjusts_only_points, scene).Solve(options);
}

double ReprojectionErrorPx(const JointScene& scene, const JointPoint& point, const JointObservation& observation) {
  const JointImage& image = scene.images[observation.image];
  const std::optional<Eigen::Vector2d> xy =
      ImageFromCam(scene.cameras[image.camera].camera, image.cam_from_world * point.point_in_world);
  return xy ? (*xy - image.keypoints[observation.keypoint]).norm() : std::numeric_limits<double>::infinity();
}

}  // namespace lazyloc
