#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/noise/variance_estimate.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Priors of the database poses, as the options state them. By default their size is estimated for each query frame, and
// the model is that of kriging (Matheron 1963): near viewpoints share most of their errors, because poses drift, and
// because errors of the intrinsics and of keypoints change with the viewpoint. So what matters to a query is by how
// much the error of a database frame differs from that at the query's own viewpoint. The variance of this difference
// grows with the distance of the viewpoints, and two frames on the same side of the query err alike: many distant
// frames cannot outvote a near one. Each frame also has an independent error.
class DatabasePriors {
 public:
  DatabasePriors(const Layout& layout, const LocalizerOptions& options);

  // Returns false if the options state that the database poses are exact.
  bool HavePriors() const { return stddev_rad_ != 0 || stddev_length_ != 0; }
  // Returns false if the options state the priors' size.
  bool AreEstimated() const { return stddev_rad_ < 0 && stddev_length_ < 0; }

  // Expects errors of this size, in pixels.
  void Expect(double noise_px);
  // Sets the priors of all database frames with observations.
  void Set(const std::vector<FrameScale>& scales, PosedImages* posed) const;
  // Estimates the size of the errors from an adjustment, and the probability that there are none. Returns the largest
  // change, as the log of a factor.
  double Estimate(const BundleAdjustmentResult& adjustment, double variance_factor);
  // Returns the variance factor of the last estimate, but at least a minimum; 1 before. Adjustment takes the images for
  // less exact than they are, so that priors would be too tight beside them: their variances are divided by it.
  double ImageVarianceFactor() const { return image_variance_factor_; }

 private:
  double UnitPx(const FrameScale& scale) const;
  PriorGroup MakeGroup(int query_frame, const std::vector<FrameScale>& scales, PosedImages* posed) const;

  const Layout& layout_;
  const double stddev_rad_, stddev_length_;   // as stated; -1: estimated
  std::vector<ExpectedPoseErrors> expected_;  // by query frame
  double image_variance_factor_ = 1;
  std::vector<std::vector<double>> variances_;  // by query frame and component
  std::vector<double> exact_probabilities_;     // of the database poses, by query frame
};

// Lets calibrations deviate as far as noise_px displaces the keypoints of the first frame that has them; 0: exact.
void SetCalibrationPriors(const Layout& layout, const std::vector<FrameScale>& scales, double noise_px,
                          PosedImages* posed);

// Returns the shape of the errors that change with the viewpoint: the covariance of the differences between the errors
// of `frames` and that at the viewpoint of `query`, where the difference at a distance of viewpoints of 0.2 has unit
// variance. That distance is the root of the sum of two squares: 2 sin(angle / 2) of the directions of view (the z
// axes), and the displacement over scene_distance.
Eigen::MatrixXd ViewpointErrorShape(const std::vector<Rigid3d>& frames, const Rigid3d& query, double scene_distance);

// Returns the variances of a group's components for the covariance of the query's pose: those that the last adjustment
// shows, but unless the poses are exact at least what poses and intrinsics of real databases are wrong by.
std::vector<double> VariancesForCovariance(const PriorGroup& group, const PriorFit& fit, double variance_factor);

// Variance of a component of a prior group that the covariance of an adjustment does not contain, because the
// adjustment took the component to be smaller than its result shows.
struct MissingVariance {
  size_t group, component;
  double variance;
};

// Returns VariancesForCovariance less those that the adjustment took for granted, times the variance factor of the
// images.
std::vector<MissingVariance> MissingVariances(const BundleAdjustmentResult& adjustment, double variance_factor);

}  // namespace lazyloc
