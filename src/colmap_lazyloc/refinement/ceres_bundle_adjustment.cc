#include "colmap_lazyloc/refinement/ceres_bundle_adjustment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "colmap_lazyloc/refinement/prior_precision.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
using Pose = std::array<double, 7>;  // quaternion x y z w, translation
using PoseManifold = ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;

// Parameters as Ceres needs them: arrays of numbers.
struct Blocks {
  std::vector<Pose> poses;                // by frame
  std::vector<double> log_scales;         // by frame
  std::vector<double> log_focal_factors;  // by image
};

Blocks ReadBlocks(const PosedImages& posed) {
  Blocks blocks;
  for (const Frame& frame : posed.frames) {
    const auto& q = frame.frame_from_world.rotation.coeffs();
    const auto& t = frame.frame_from_world.translation;
    blocks.poses.push_back({q[0], q[1], q[2], q[3], t[0], t[1], t[2]});
    blocks.log_scales.push_back(0);
  }
  for (const Image& image : posed.images) blocks.log_focal_factors.push_back(image.log_focal_factor.value_or(0));
  return blocks;
}

void WriteBlocks(const Blocks& blocks, PosedImages* posed) {
  for (size_t i = 0; i < posed->frames.size(); ++i) {
    if (IsConstant(posed->frames[i])) continue;
    const Pose& pose = blocks.poses[i];
    posed->frames[i].frame_from_world = {Eigen::Quaterniond(pose.data()), Eigen::Vector3d(pose[4], pose[5], pose[6])};
    posed->frames[i].scale *= std::exp(blocks.log_scales[i]);
  }
  for (size_t i = 0; i < posed->images.size(); ++i) {
    Image& image = posed->images[i];
    image.cam_from_frame.translation *= std::exp(blocks.log_scales[image.frame]);
    if (image.log_focal_factor) image.log_focal_factor = blocks.log_focal_factors[i];
  }
}

// Computes the reprojection error in standard deviations.
struct ObservationCost {
  Observation observation;
  Rigid3d cam_from_frame;
  double stddev_px;

  template <typename T>
  bool operator()(const T* frame_from_world, const T* log_scale, const T* log_focal_factor, const T* point_in_world,
                  T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(frame_from_world);
    const Eigen::Map<const Vector3<T>> translation(frame_from_world + 4), point(point_in_world);
    const Vector3<T> point_in_frame = rotation * point + translation;
    const Vector3<T> point_in_cam =
        cam_from_frame.rotation.cast<T>() * point_in_frame + exp(*log_scale) * cam_from_frame.translation.cast<T>();
    const T depth = observation.ray_in_cam.cast<T>().dot(point_in_cam);
    Eigen::Map<Eigen::Matrix<T, 2, 1>> error(residual);
    error = observation.px_from_cam.cast<T>() * point_in_cam / depth +
            *log_focal_factor * observation.px_from_log_focal.cast<T>();
    error /= T(stddev_px);
    return depth > T(0);  // false makes Ceres reject the step
  }
};

// Computes the deviations of several frames from their priors, made independent: root * root^T is the inverse
// covariance of the deviations in the priors' standard deviations, in a coordinate of the rotation or of the position.
struct PriorCost {
  std::vector<PosePrior> priors;
  Eigen::MatrixXd rotation_root, position_root;

  template <typename T>
  bool operator()(T const* const* frames_from_world, T* residual) const {
    Eigen::Matrix<T, Eigen::Dynamic, 6, Eigen::RowMajor> deviations(priors.size(), 6);
    for (size_t i = 0; i < priors.size(); ++i) Evaluate(priors[i], frames_from_world[i], deviations.row(i).data());
    Eigen::Map<Eigen::Matrix<T, Eigen::Dynamic, 6, Eigen::RowMajor>> independent(residual, priors.size(), 6);
    independent.template leftCols<3>() = rotation_root.transpose().cast<T>() * deviations.template leftCols<3>();
    independent.template rightCols<3>() = position_root.transpose().cast<T>() * deviations.template rightCols<3>();
    return true;
  }

  // Computes the rotation vector in the world's axes, then the displacement of the origin.
  template <typename T>
  static void Evaluate(const PosePrior& prior, const T* frame_from_world, T* deviation) {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(frame_from_world);
    const Eigen::Map<const Vector3<T>> translation(frame_from_world + 4);
    const Eigen::Quaternion<T> turn = prior.frame_from_world.rotation.conjugate().cast<T>() * rotation;
    const T scalar_first[4] = {turn.w(), turn.x(), turn.y(), turn.z()};
    ceres::QuaternionToAngleAxis(scalar_first, deviation);
    const Vector3<T> displacement = rotation.conjugate() * -translation - CamInWorld(prior.frame_from_world).cast<T>();
    for (int i = 0; i < 3; ++i) {
      deviation[i] /= T(prior.rotation_stddev_rad);
      deviation[i + 3] = displacement[i] / T(prior.position_stddev);
    }
  }
};

class CeresSolver {
 public:
  CeresSolver(const PosedImages& posed, const std::vector<Track>& tracks, const CeresOptions& options)
      : options_(options), blocks_(ReadBlocks(posed)) {
    result_.posed = posed;
    result_.tracks = tracks;
    for (size_t frame = 0; frame < posed.frames.size(); ++frame) AddFrame(frame);
    for (const PriorGroup& group : posed.prior_groups) AddPriors(group.frames, ComputePriorPrecision(group));
    for (size_t image = 0; image < posed.images.size(); ++image) {
      problem_.AddParameterBlock(&blocks_.log_focal_factors[image], 1);
      if (!posed.images[image].log_focal_factor) {
        problem_.SetParameterBlockConstant(&blocks_.log_focal_factors[image]);
      }
    }
    for (Track& track : result_.tracks) AddTrack(&track);
  }

  CeresAdjustment Solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = options_.solves_sparsely ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
    options.max_num_iterations = options_.max_num_iterations;
    options.function_tolerance = options_.function_tolerance;
    options.parameter_tolerance = options.gradient_tolerance = 1e-16;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    result_.summary = {summary.IsSolutionUsable(), summary.message,
                       summary.num_successful_steps + summary.num_unsuccessful_steps, summary.final_cost};
    if (!result_.summary.success) return std::move(result_);
    if (options_.computes_covariances) AddCovariances();
    WriteBlocks(blocks_, &result_.posed);
    return std::move(result_);
  }

 private:
  void AddFrame(size_t i) {
    const Frame& frame = result_.posed.frames[i];
    double* pose = blocks_.poses[i].data();
    problem_.AddParameterBlock(pose, 7, new PoseManifold);
    problem_.AddParameterBlock(&blocks_.log_scales[i], 1);
    if (IsConstant(frame)) problem_.SetParameterBlockConstant(pose);
    if (!frame.has_free_scale) problem_.SetParameterBlockConstant(&blocks_.log_scales[i]);
    const auto has_frame = [&](const PriorGroup& group) {
      return std::find(group.frames.begin(), group.frames.end(), static_cast<int>(i)) != group.frames.end();
    };
    const std::vector<PriorGroup>& groups = result_.posed.prior_groups;
    if (!frame.prior || std::any_of(groups.begin(), groups.end(), has_frame)) return;
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(1, 1);
    AddPriors({static_cast<int>(i)}, {one, one});
  }

  void AddPriors(const std::vector<int>& frames, const PriorPrecision& precision) {
    auto* cost = new PriorCost{{}, precision.rotation.llt().matrixL(), precision.position.llt().matrixL()};
    auto* function = new ceres::DynamicAutoDiffCostFunction<PriorCost>(cost);
    std::vector<double*> poses;
    for (const int frame : frames) {
      cost->priors.push_back(*result_.posed.frames[frame].prior);
      poses.push_back(blocks_.poses[frame].data());
      function->AddParameterBlock(7);
    }
    function->SetNumResiduals(static_cast<int>(6 * frames.size()));
    problem_.AddResidualBlock(function, nullptr, poses);
  }

  void AddTrack(Track* track) {
    for (const TrackObservation& element : track->observations) {
      const Image& image = result_.posed.images[element.image];
      auto* cost = new ObservationCost{element.observation, image.cam_from_frame, track->noise_ratio * image.noise_px};
      problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<ObservationCost, 2, 7, 1, 1, 3>(cost),
                                new ceres::CauchyLoss(options_.loss_scale_sigma), blocks_.poses[image.frame].data(),
                                &blocks_.log_scales[image.frame], &blocks_.log_focal_factors[element.image],
                                track->point_in_world.data());
    }
  }

  void AddCovariances() {
    std::vector<std::pair<const double*, const double*>> wanted;
    for (size_t i = 0; i < blocks_.poses.size(); ++i) {
      const double *pose = blocks_.poses[i].data(), *scale = &blocks_.log_scales[i];
      if (!problem_.IsParameterBlockConstant(pose)) wanted.emplace_back(pose, pose);
      if (problem_.IsParameterBlockConstant(scale)) continue;
      wanted.emplace_back(pose, scale);
      wanted.emplace_back(scale, scale);
    }
    for (const double& factor : blocks_.log_focal_factors) {
      if (!problem_.IsParameterBlockConstant(&factor)) wanted.emplace_back(&factor, &factor);
    }
    for (const Track& track : result_.tracks) {
      wanted.emplace_back(track.point_in_world.data(), track.point_in_world.data());
    }
    ceres::Covariance covariance({});
    LAZYLOC_CHECK(covariance.Compute(wanted, &problem_));
    for (const Image& image : result_.posed.images) {
      result_.image_covariances.push_back(ImageCovariance(image, covariance));
    }
    for (const double& scale : blocks_.log_scales) result_.scale_variances.push_back(Variance(scale, covariance));
    for (const double& factor : blocks_.log_focal_factors) {
      result_.focal_variances.push_back(Variance(factor, covariance));
    }
    for (const Track& track : result_.tracks) {
      const double* point = track.point_in_world.data();
      result_.point_covariances.emplace_back();  // filled row by row, which makes no difference: it is symmetric
      covariance.GetCovarianceBlock(point, point, result_.point_covariances.back().data());
    }
  }

  // Transforms the covariance of the frame into that of the image's tangent, by x_cam = R x_frame + exp(log_scale) t.
  Matrix6d ImageCovariance(const Image& image, const ceres::Covariance& covariance) const {
    const double *pose = blocks_.poses[image.frame].data(), *scale = &blocks_.log_scales[image.frame];
    if (problem_.IsParameterBlockConstant(pose)) return Matrix6d::Zero();
    Eigen::Matrix<double, 7, 7> of_frame = Eigen::Matrix<double, 7, 7>::Zero();
    Matrix6d of_pose;
    covariance.GetCovarianceBlockInTangentSpace(pose, pose, of_pose.data());
    of_frame.topLeftCorner<6, 6>() = of_pose;
    if (!problem_.IsParameterBlockConstant(scale)) {
      Eigen::Matrix<double, 6, 1> with_scale;
      covariance.GetCovarianceBlockInTangentSpace(pose, scale, with_scale.data());
      covariance.GetCovarianceBlock(scale, scale, &of_frame(6, 6));
      of_frame.topRightCorner<6, 1>() = with_scale;
      of_frame.bottomLeftCorner<1, 6>() = with_scale.transpose();
    }
    const Eigen::Matrix3d rotation = image.cam_from_frame.rotation.toRotationMatrix();
    Eigen::Matrix<double, 6, 7> jacobian = Eigen::Matrix<double, 6, 7>::Zero();
    jacobian.topLeftCorner<3, 3>() = 2 * rotation;  // because Ceres' tangent of a quaternion is half the angle
    jacobian.block<3, 3>(3, 3) = rotation;
    jacobian.col(6).tail<3>() = std::exp(*scale) * image.cam_from_frame.translation;
    return jacobian * of_frame * jacobian.transpose();
  }

  std::optional<double> Variance(const double& parameter, const ceres::Covariance& covariance) const {
    if (problem_.IsParameterBlockConstant(&parameter)) return std::nullopt;
    double variance;
    covariance.GetCovarianceBlock(&parameter, &parameter, &variance);
    return variance;
  }

  const CeresOptions& options_;
  Blocks blocks_;
  CeresAdjustment result_;
  ceres::Problem problem_;
};

}  // namespace

CeresAdjustment AdjustWithCeres(const PosedImages& posed, const std::vector<Track>& tracks,
                                const CeresOptions& options) {
  return CeresSolver(posed, tracks, options).Solve();
}

}  // namespace lazyloc
