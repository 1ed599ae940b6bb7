#include "colmap_lazyloc/noise/database_priors.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_pose_errors.h"

namespace lazyloc {
namespace {

// Distance of viewpoints at which the size of pose errors is expected, and the power of it by which variances grow:
// between that of a random walk (1) and that of errors which change steadily (2).
constexpr double kReferenceDistance = 0.2;
constexpr double kPower = 1.5;
// What a covariance allows for beyond the estimate unless the poses are exact: errors in pixels that no adjustment
// shows, because they are common to all images. Calibrated on real scenes (docs/method.md, section 9).
constexpr double kHiddenNoisePx = 0.2;

// Minimum error of database poses over the stated one.
constexpr double kMinStatedRatio = 0.1;
// Displacement of keypoints by the flex of a rig.
constexpr double kRigTolerancePx = 0.02;

// Probability that database poses are exact before the images are used, as those of rendered images are.
constexpr double kExactProbability = 0.3;
// Minimum share of the variances that remains where poses are exact, because equations would be singular else.
constexpr double kMinVarianceShare = 1e-3;

constexpr size_t kNumComponents = 3;  // errors that change with the viewpoint, independent rotations, positions

double ViewpointVariance(const Rigid3d& a, const Rigid3d& b, double scene_distance) {
  // Takes the directions of view, because a camera that is turned on its side sees the same. Takes their chord
  // 2 sin(angle / 2), because the covariances are positive definite for distances in a Euclidean space.
  const double chord = (a.rotation.toRotationMatrix().row(2) - b.rotation.toRotationMatrix().row(2)).norm();
  const double displacement = (CamInWorld(a) - CamInWorld(b)).norm() / scene_distance;
  return std::pow(std::hypot(chord, displacement) / kReferenceDistance, kPower);
}

// Returns the median scale of frames with observations; a zero scale if there is none.
FrameScale CommonScale(const std::vector<int>& frames, const std::vector<FrameScale>& scales) {
  std::vector<double> focal_lengths_px, distances;
  for (const int frame : frames) {
    if (scales[frame].distance == 0) continue;
    focal_lengths_px.push_back(scales[frame].focal_length_px);
    distances.push_back(scales[frame].distance);
  }
  if (distances.empty()) return {};
  return {Median(std::move(focal_lengths_px)), Median(std::move(distances))};
}

// Returns the probability that database poses are exact. log_bayes_factor: of errors of these poses over none.
double ExactProbability(double log_bayes_factor) {
  return 1 / (1 + (1 - kExactProbability) / kExactProbability * std::exp(log_bayes_factor));
}

}  // namespace

Eigen::MatrixXd ViewpointErrorShape(const std::vector<Rigid3d>& frames, const Rigid3d& query, double scene_distance) {
  const auto size = static_cast<Eigen::Index>(frames.size());
  Eigen::VectorXd to_query(size);
  for (Eigen::Index i = 0; i < size; ++i) to_query[i] = ViewpointVariance(frames[i], query, scene_distance);
  Eigen::MatrixXd shape(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      shape(i, j) = (to_query[i] + to_query[j] - ViewpointVariance(frames[i], frames[j], scene_distance)) / 2;
    }
  }
  return shape;
}

DatabasePriors::DatabasePriors(const Layout& layout, const LocalizerOptions& options)
    : layout_(layout),
      stddev_rad_(options.database_pose_stddev_deg < 0 ? -1 : DegToRad(options.database_pose_stddev_deg)),
      stddev_length_(options.database_pose_stddev_length),
      expected_(layout.expected_pose_errors),
      exact_probabilities_(layout.num_query_frames, 0.0) {
  if (expected_.empty()) expected_.assign(layout.num_query_frames, ExpectPoseErrors(options));
  for (const ExpectedPoseErrors& errors : expected_) {
    variances_.emplace_back();
    for (const ExpectedStddev& size : errors.sizes) variances_.back().push_back(size.median * size.median);
  }
}

void DatabasePriors::Expect(double noise_px) {
  for (std::vector<double>& variances : variances_) variances.assign(kNumComponents, noise_px * noise_px);
}

// Returns the displacement of keypoints that a standard deviation of one stands for: a pixel if the size is estimated.
// If only rotation or position is stated, the other is taken to displace keypoints as much.
double DatabasePriors::UnitPx(const FrameScale& scale) const {
  if (stddev_rad_ >= 0 && stddev_length_ < 0) return stddev_rad_ * scale.focal_length_px;
  if (stddev_length_ >= 0 && stddev_rad_ < 0) return stddev_length_ * scale.focal_length_px / scale.distance;
  return 1;
}

PriorGroup DatabasePriors::MakeGroup(int query_frame, const std::vector<FrameScale>& scales, PosedImages* posed) const {
  const FrameScale common = CommonScale(layout_.database_frames_of_frame[query_frame], scales);
  PriorGroup group;
  std::vector<Rigid3d> poses;
  for (const int frame : layout_.database_frames_of_frame[query_frame]) {
    std::optional<PosePrior>& prior = posed->frames[frame].prior;
    prior.reset();
    if (scales[frame].distance == 0) continue;  // no observations
    const Rigid3d& given = layout_.given.frames[frame].frame_from_world;
    prior = MakePosePrior(given, UnitPx(common), common);
    // A stated zero beside a nonzero value means as good as exact.
    const PosePrior smallest = MakePosePrior(given, 1e-3, common);
    if (stddev_rad_ >= 0) prior->rotation_stddev_rad = std::max(stddev_rad_, smallest.rotation_stddev_rad);
    if (stddev_length_ >= 0) prior->position_stddev = std::max(stddev_length_, smallest.position_stddev);
    group.frames.push_back(frame);
    poses.push_back(given);
  }
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(size, size);
  if (!AreEstimated()) {
    group.components = {{identity, 1}};
    return group;
  }
  const Rigid3d& query = posed->frames[query_frame].frame_from_world;
  const std::vector<double>& variances = variances_[query_frame];
  group.components = {{ViewpointErrorShape(poses, query, common.distance), variances[0]},
                      {identity, variances[1], PosePart::ROTATION},
                      {identity, variances[2], PosePart::POSITION}};
  if (variances.size() > kNumComponents) {
    group.components.push_back({Eigen::MatrixXd::Ones(size, size), variances[kNumComponents], PosePart::POSITION});
  }
  group.exact_probability = exact_probabilities_[query_frame];
  return group;
}

void DatabasePriors::Set(const std::vector<FrameScale>& scales, PosedImages* posed) const {
  posed->prior_groups.clear();
  if (!HavePriors()) return;
  for (int query_frame = 0; query_frame < layout_.num_query_frames; ++query_frame) {
    posed->prior_groups.push_back(MakeGroup(query_frame, scales, posed));
  }
}

double DatabasePriors::Estimate(const BundleAdjustmentResult& adjustment, double variance_factor) {
  image_variance_factor_ = std::max(variance_factor, kMinVarianceFactor);
  if (!AreEstimated()) return 0;
  double change = 0;
  for (size_t i = 0; i < adjustment.prior_fits.size(); ++i) {
    const VarianceEstimate estimate = EstimateVariances(adjustment.posed.prior_groups[i], adjustment.prior_fits[i],
                                                        image_variance_factor_, expected_[i].sizes);
    exact_probabilities_[i] = ExactProbability(estimate.log_bayes_factor);
    const double share = std::max(1 - exact_probabilities_[i], kMinVarianceShare);
    for (size_t j = 0; j < estimate.variances.size(); ++j) {
      const double variance = share * estimate.variances[j] / image_variance_factor_;
      change = std::max(change, std::abs(std::log(variance / variances_[i][j])) / 2);
      variances_[i][j] = variance;
    }
  }
  return change;
}

void SetCalibrationPriors(const Layout& layout, const std::vector<FrameScale>& scales, double noise_px,
                          PosedImages* posed) {
  if (noise_px == 0 || posed->calibrations.empty()) return;
  for (Calibration& calibration : posed->calibrations) calibration.prior.reset();
  for (const Image& image : posed->images) {
    if (image.calibration < 0) continue;
    Calibration& calibration = posed->calibrations[image.calibration];
    const FrameScale& scale = scales[image.frame];
    if (calibration.prior || scale.distance == 0) continue;
    Rigid3d given = layout.given.calibrations[image.calibration].cam_from_frame;
    // Takes cameras at one point as exact: they are the faces of a panorama, because no real lenses are that near.
    if (CamInWorld(given).isZero()) continue;
    given.translation *= posed->frames[image.frame].scale;
    calibration.prior = MakePosePrior(given, noise_px, scale);
    const PosePrior flex = MakePosePrior(given, kRigTolerancePx, scale);
    calibration.flex_rad = flex.rotation_stddev_rad;
    calibration.flex_length = flex.position_stddev;
  }
}

std::vector<double> VariancesForCovariance(const PriorGroup& group, const PriorFit& fit, double variance_factor) {
  if (group.HasStatedSizes()) {
    return EstimateVariances(group, fit, std::max(variance_factor, kMinVarianceFactor), {{1, 1, kMinStatedRatio, 1}})
        .variances;
  }
  std::vector<double> variances;
  for (size_t j = 0; j < group.components.size(); ++j) {
    const double hidden = (1 - group.exact_probability) * kHiddenNoisePx * kHiddenNoisePx;
    variances.push_back(variance_factor * group.components[j].variance + hidden);
  }
  return variances;
}

std::vector<MissingVariance> MissingVariances(const BundleAdjustmentResult& adjustment, double variance_factor) {
  std::vector<MissingVariance> missing;
  for (size_t i = 0; i < adjustment.prior_fits.size(); ++i) {
    const PriorGroup& group = adjustment.posed.prior_groups[i];
    const std::vector<double> variances = VariancesForCovariance(group, adjustment.prior_fits[i], variance_factor);
    for (size_t j = 0; j < variances.size(); ++j) {
      missing.push_back({i, j, variances[j] - variance_factor * group.components[j].variance});
    }
  }
  return missing;
}

}  // namespace lazyloc
