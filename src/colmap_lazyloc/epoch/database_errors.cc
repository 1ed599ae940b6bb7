#include "colmap_lazyloc/epoch/database_errors.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/epoch/information_factor.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_pose_errors.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"
#include "colmap_lazyloc/refinement/prior_precision.h"
#include "colmap_lazyloc/refinement/sparse_precision.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using PoseByCorrections = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;
using SparseMatrix = Eigen::SparseMatrix<double>;
using RowMajorMatrix = Eigen::SparseMatrix<double, Eigen::RowMajor>;

constexpr size_t kMaxNumDenseImages = 150;
// Expected shift of the database against a survey, in pixels, in logs, and the first and smallest one that is tried: a
// survey in another frame is off by many pixels, one that the database was adjusted with by less than one.
constexpr ExpectedStddev kShift = {3, 2, 0.02, 3};

Layout MakeEpochLayout(const JointScene& scene) {
  Layout layout;
  layout.num_query_frames = 1;
  layout.given.frames.emplace_back();
  layout.queries_of_frame.resize(1);
  layout.database_frames_of_frame.resize(1);
  for (const JointImage& given : scene.images) {
    Image image;
    image.frame = 0;
    if (given.is_database) {
      image.frame = static_cast<int>(layout.given.frames.size());
      layout.database_frames_of_frame[0].push_back(image.frame);
      Frame& frame = layout.given.frames.emplace_back();
      frame.frame_from_world = given.cam_from_world;
      frame.is_database = true;
    } else {
      layout.queries_of_frame[0].push_back(layout.num_queries++);
    }
    layout.given.images.push_back(image);
  }
  if (!scene.control_points.empty()) {
    layout.expected_pose_errors.push_back(ExpectPoseErrors(LocalizerOptions()));
    layout.expected_pose_errors[0].sizes.push_back(kShift);
  }
  return layout;
}

std::vector<FrameScale> MeasureScales(const JointScene& scene, const Layout& layout) {
  std::vector<std::vector<double>> distances(layout.given.frames.size());
  for (const JointPoint& point : scene.points) {
    for (const JointObservation& observation : point.observations) {
      const Rigid3d& pose = scene.images[observation.image].cam_from_world;
      distances[layout.FrameOf(observation.image)].push_back((pose * point.point_in_world).norm());
    }
  }
  std::vector<FrameScale> scales(layout.given.frames.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int frame = layout.FrameOf(static_cast<int>(i));
    if (distances[frame].empty()) continue;
    scales[frame] = {MeanFocalLength(scene.cameras[scene.images[i].camera].camera), HarmonicMean(distances[frame])};
  }
  return scales;
}

bool IsDense(const PriorGroup& group) { return group.frames.size() <= kMaxNumDenseImages; }

// Returns a root of the precision of the deviations that adjustment uses.
RowMajorMatrix RootOf(const PriorGroup& group, PosePart part) {
  if (!IsDense(group)) return SparseRootOfPrecision(ComputePriorCovariance(group, part));
  return Eigen::MatrixXd(ComputePriorPrecision(group, part).llt().matrixU()).sparseView();
}

PriorPrecision PrecisionOf(const PriorGroup& group) {
  if (IsDense(group)) return ComputePriorPrecision(group);
  const RowMajorMatrix rotation = RootOf(group, PosePart::ROTATION), position = RootOf(group, PosePart::POSITION);
  return {rotation.transpose() * rotation, position.transpose() * position};
}

// Returns a group with the frames nearest to the viewpoint that errors are relative to, as many as a dense matrix
// solves.
PriorGroup NearestOf(const PriorGroup& group) {
  std::vector<Eigen::Index> nearest(group.frames.size());
  std::iota(nearest.begin(), nearest.end(), 0);
  const Eigen::VectorXd variances = group.components[0].shape.diagonal();
  std::stable_sort(nearest.begin(), nearest.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return variances[a] < variances[b]; });
  nearest.resize(std::min(nearest.size(), kMaxNumDenseImages));
  std::sort(nearest.begin(), nearest.end());
  PriorGroup of_nearest = group;
  of_nearest.frames.clear();
  for (const Eigen::Index i : nearest) of_nearest.frames.push_back(group.frames[i]);
  for (VarianceComponent& component : of_nearest.components) {
    component.shape = component.shape(nearest, nearest).eval();
  }
  return of_nearest;
}

// Returns the place of the deviations in the information of an adjustment: six consecutive parameters by frame.
std::vector<int> PlacesOf(const PriorGroup& group, int num_queries, const JointAdjustment& adjustment) {
  std::vector<int> places;
  for (const int frame : group.frames) places.push_back(adjustment.first_parameter[frame - 1 + num_queries]);
  return places;
}

// Gives the priors the variances that covariances allow for. Returns how this changes the information of an adjustment.
// places: by PlacesOf.
SparseMatrix WidenPriors(const JointAdjustment& adjustment, const std::vector<int>& places, PriorGroup* group) {
  const PriorPrecision precision = PrecisionOf(*group);
  const std::vector<double> variances = VariancesForCovariance(*group, {}, adjustment.variance_factor);
  for (size_t i = 0; i < variances.size(); ++i) {
    group->components[i].variance = variances[i] / adjustment.variance_factor;
  }
  const PriorPrecision wider = PrecisionOf(*group);
  const auto size = static_cast<Eigen::Index>(places.size());
  std::vector<Eigen::Triplet<double>> changes;
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      for (int k = 0; k < 6; ++k) {
        const double difference = wider.Of(k)(i, j) - precision.Of(k)(i, j);
        if (difference != 0) changes.emplace_back(places[i] + k, places[j] + k, difference);
      }
    }
  }
  SparseMatrix change(adjustment.information.rows(), adjustment.information.cols());
  change.setFromTriplets(changes.begin(), changes.end());
  return change;
}

// Returns the information of the images on the deviations, without the priors, with all other parameters eliminated.
// One coordinate of all frames after the other.
Eigen::MatrixXd InformationOnDeviations(const InformationFactor& factor, const PriorPrecision& precision) {
  Eigen::MatrixXd kept = factor.OnDeviations();
  const Eigen::Index size = kept.rows() / 6;
  for (Eigen::Index k = 0; k < 6; ++k) kept.block(k * size, k * size, size, size) -= precision.Of(k);
  return kept;
}

// Returns the derivative of a pose's tangent by the error at its viewpoint, in the prior's standard deviations, when
// the error is taken away (RelativeToGivenDatabase).
Matrix6d TangentFromError(const Rigid3d& pose, const PosePrior& unit) {
  const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
  Matrix6d derivative = Matrix6d::Zero();
  derivative.topLeftCorner<3, 3>() = -unit.rotation_stddev_rad * rotation;
  derivative.bottomLeftCorner<3, 3>() = unit.rotation_stddev_rad * Hat(pose.translation) * rotation;
  derivative.bottomRightCorner<3, 3>() = unit.position_stddev * rotation;
  return derivative;
}

}  // namespace

DatabaseErrors::DatabaseErrors(const JointScene& given)
    : is_surveyed_(!given.control_points.empty()),
      layout_(MakeEpochLayout(given)),
      priors_(layout_, LocalizerOptions()) {}

PosedImages DatabaseErrors::PosedBy(const JointScene& scene) const {
  PosedImages posed = posed_.frames.empty() ? layout_.given : posed_;
  const Rigid3d& first = scene.images.front().cam_from_world;
  posed.frames[0].frame_from_world = first;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Rigid3d& pose = scene.images[i].cam_from_world;
    if (layout_.IsDatabase(static_cast<int>(i))) {
      posed.frames[FrameOf(i)].frame_from_world = pose;
    } else {
      posed.images[i].cam_from_frame = pose * Inverse(first);
    }
  }
  return posed;
}

void DatabaseErrors::SetPriors(JointScene* scene) {
  posed_ = PosedBy(*scene);
  priors_.Set(MeasureScales(*scene, layout_), &posed_);
  for (size_t i = layout_.num_queries; i < scene->images.size(); ++i) {
    scene->images[i].prior = posed_.frames[FrameOf(i)].prior;
    if (!scene->images[i].prior) scene->images[i].cam_from_world = layout_.given.frames[FrameOf(i)].frame_from_world;
  }
  scene->rotation_root = RootOf(posed_.prior_groups[0], PosePart::ROTATION);
  scene->position_root = RootOf(posed_.prior_groups[0], PosePart::POSITION);
}

void DatabaseErrors::Estimate(const JointScene& scene, const JointAdjustment& adjustment) {
  if (posed_.prior_groups[0].frames.empty()) return;
  const PriorGroup group = NearestOf(posed_.prior_groups[0]);
  const InformationFactor factor(adjustment.information, PlacesOf(group, layout_.num_queries, adjustment));
  if (!factor.Succeeded()) return;
  BundleAdjustmentResult result;
  result.posed = PosedBy(scene);
  result.posed.prior_groups = {group};
  result.prior_fits.push_back(
      {MeasureDeviations(result.posed, group), InformationOnDeviations(factor, ComputePriorPrecision(group))});
  priors_.Estimate(result, adjustment.variance_factor);
}

std::vector<Matrix6d> DatabaseErrors::PhotoCovariances(const JointScene& scene,
                                                       const JointAdjustment& adjustment) const {
  std::vector<Matrix6d> covariances(layout_.num_queries, Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN()));
  const PosedImages posed = PosedBy(scene);
  PriorGroup group = posed.prior_groups[0];
  const std::vector<int> places = PlacesOf(group, layout_.num_queries, adjustment);
  const auto size = static_cast<Eigen::Index>(places.size());
  const SparseMatrix change = WidenPriors(adjustment, places, &group);
  const InformationFactor factor(adjustment.information + change, places);
  if (!factor.Succeeded()) return covariances;
  // The negative derivative of the parameters by corrections of the cameras.
  const Eigen::MatrixXd by_corrections = factor.Solve(Eigen::MatrixXd(adjustment.coupling_with_cameras));
  std::vector<Rigid3d> viewpoints;
  for (int i = 0; i < layout_.num_queries; ++i) viewpoints.push_back(scene.images[i].cam_from_world);
  PredictedErrors predicted;
  const bool returns = size > 0 && !is_surveyed_;
  if (returns) predicted = PredictErrors(posed, group, viewpoints.front(), viewpoints);
  for (int i = 0; i < layout_.num_queries; ++i) {
    const int first = adjustment.first_parameter[i];
    if (first < 0) continue;
    Eigen::MatrixXd gain = Eigen::MatrixXd::Zero(6 * size, 6);  // with respect to the deviations
    Matrix6d of_prediction = Matrix6d::Zero();
    if (returns) {
      const Matrix6d derivative = TangentFromError(viewpoints[i], *posed.frames[group.frames.front()].prior);
      for (int k = 0; k < 6; ++k) {
        const Eigen::MatrixXd& predictions = k < 3 ? predicted.by_rotation : predicted.by_position;
        gain.middleRows(k * size, size) = predictions.row(i).transpose() * derivative.col(k).transpose();
      }
      Eigen::Matrix<double, 6, 1> unpredicted;
      unpredicted << Eigen::Vector3d::Constant(predicted.rotation_variances[i]),
          Eigen::Vector3d::Constant(predicted.position_variances[i]);
      of_prediction = derivative * unpredicted.asDiagonal() * derivative.transpose();
    }
    const int camera = scene.images[i].camera;
    const auto of_camera = by_corrections.middleCols<NUM_INTRINSICS_PARAMETERS>(NUM_INTRINSICS_PARAMETERS * camera);
    PoseByCorrections by_camera = of_camera.middleRows<6>(first);
    for (Eigen::Index j = 0; j < size; ++j) {
      for (int k = 0; k < 6; ++k) by_camera += gain.row(k * size + j).transpose() * of_camera.row(places[j] + k);
    }
    const Matrix6d covariance = adjustment.variance_factor * (factor.Covariance(first, gain) + of_prediction) +
                                by_camera * scene.cameras[camera].covariance * by_camera.transpose();
    if (covariance.diagonal().minCoeff() > 0) covariances[i] = (covariance + covariance.transpose()) / 2;
  }
  return covariances;
}

void DatabaseErrors::ReturnToGivenDatabase(const JointAdjustment& adjustment, JointScene* scene) const {
  const PosedImages reported = RelativeToGivenDatabase(layout_, PosedBy(*scene));
  for (size_t i = 0; i < scene->images.size(); ++i) {
    JointImage& image = scene->images[i];
    if (image.is_database) {
      image.cam_from_world = layout_.given.frames[FrameOf(i)].frame_from_world;
    } else if (adjustment.first_parameter[i] >= 0 && !is_surveyed_) {
      image.cam_from_world = CamFromWorld(reported, static_cast<int>(i));
    }
    image.prior.reset();
  }
  scene->rotation_root.resize(0, 0);
  scene->position_root.resize(0, 0);
}

}  // namespace lazyloc
