#pragma once

#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/depth_residual.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/refinement/parameter_block.h"
#include "colmap_lazyloc/refinement/prior_precision.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// An observation of a point in a frame that moves, or a depth of the point: then `frame` is the scale of its map, and
// only `depth` is set beside it.
struct FreeObservation {
  int frame;                    // index into BundleProblem::frames
  LinearProjection projection;  // of the point in the frame's axes
  Eigen::Vector2d residual_from_log_focal;
  int element;     // index into the track's observations
  int depth = -1;  // index into BundleProblem::depths; -1: none
};

// Reprojection error of a point, and its derivatives.
struct BundleError {
  Eigen::Vector2d error;
  Eigen::Matrix<double, 2, 3> by_point;                     // in the axes of the projection
  Eigen::Vector2d by_log_factor = Eigen::Vector2d::Zero();  // of the frame
  Eigen::Vector3d rotated_point;                            // into the frame's axes

  // Computes the error. Returns false if the point lies behind the camera.
  bool Evaluate(const LinearProjection& projection, const Eigen::Vector3d& point) {
    if (!(projection.Depth(point) > 0)) return false;
    error = projection.Error(point, &by_point);
    return true;
  }
  bool Evaluate(const FreeObservation& observation, const ParameterBlock& frame, const Eigen::Vector3d& point) {
    rotated_point = frame.rotation.lazyProduct(point);
    const Eigen::Vector3d point_in_frame = rotated_point + frame.frame_from_world.translation;
    if (frame.HasRigScale()) {
      const LinearProjection scaled = observation.projection.WithOffset(std::exp(frame.log_factor));
      if (!Evaluate(scaled, point_in_frame)) return false;
      by_log_factor = scaled.DerivativeByLogOffset(point_in_frame, error);
      return true;
    }
    if (!Evaluate(observation.projection, point_in_frame)) return false;
    by_log_factor = observation.residual_from_log_focal;
    error += frame.log_factor * by_log_factor;
    return true;
  }

  // Return the derivatives with respect to the frame's parameters (transposed) and the point in the world, after
  // Evaluate of a free observation.
  template <int kSize>
  Eigen::Matrix<double, kSize, 2> ByFrame() const {
    Eigen::Matrix<double, kSize, 2> by_frame;
    // d(point_in_frame)/dw = -Hat(rotated_point): each row of the product is a cross product.
    by_frame.col(0).template head<3>() = rotated_point.cross(by_point.row(0).transpose());
    by_frame.col(1).template head<3>() = rotated_point.cross(by_point.row(1).transpose());
    by_frame.template middleRows<3>(3) = by_point.transpose();
    if (kSize > 6) by_frame.row(kSize - 1) = by_log_factor.transpose();
    return by_frame;
  }
  Eigen::Matrix<double, 2, 3> ByPointInWorld(const ParameterBlock& frame) const {
    return by_point.lazyProduct(frame.rotation);
  }

  void Scale(double factor) {
    error *= factor;
    by_point *= factor;
    by_log_factor *= factor;
  }
};

// An image whose place in its frame follows a calibration with a prior: all three move.
struct BundleFlex {
  int frame = -1, calibration = -1, cam = -1;  // indices into BundleProblem::frames, ascending
  const Calibration* given = nullptr;
};

// The scale of a depth map, and its prior.
struct BundleDepthMap {
  int frame = -1;  // index into BundleProblem::frames
  double log_scale = 0;
  double stddev = 1;
};

// An image with a prior of its query.
struct BundleQueryPrior {
  int frame = -1;          // index into BundleProblem::frames
  Rigid3d cam_from_frame;  // identity if the image moves by itself
  QueryPrior prior;
};

// Indices [begin, end) of an array of observations.
struct Range {
  size_t begin = 0, end = 0;
};

// Priors of frames whose deviations are correlated.
struct BundlePriors {
  std::vector<int> frames;  // indices into BundleProblem::frames, ascending
  PriorPrecision precision;
};

// Frames and tracks as bundle adjustment iterates over them: contiguous in memory, errors in standard deviations.
struct BundleProblem {
  BundleProblem(const PosedImages& posed, const std::vector<Track>& tracks);

  std::vector<int> index_of_frame;  // by frame of PosedImages, into `frames`; -1 for constant frames
  std::vector<int> index_of_image;  // by image: its own index if its calibration has a prior, else its frame's
  std::vector<Rigid3d>
      cams_from_axes;  // by image, from the axes of the pose at that index, or of the world if constant
  // Frames that move, then calibrations with a prior, then their images, then scales of depth maps.
  std::vector<ParameterBlock> frames;
  std::vector<const PosePrior*> pose_priors;  // parallel to `frames`; nullptr if the pose has no prior
  std::vector<BundlePriors> priors;           // those of posed.prior_groups in their order, then of single frames
  std::vector<int> index_of_calibration;      // by calibration of PosedImages; -1 if it has no prior
  std::vector<BundleFlex> flexes;
  std::vector<int> index_of_depth_map;  // by image, into `frames`; -1 for an image without a map
  std::vector<BundleDepthMap> depth_maps;
  std::vector<DepthObservation> depths;
  std::vector<BundleQueryPrior> query_priors;
  std::vector<Eigen::Vector3d> points;         // by track
  std::vector<LinearProjection> fixed;         // observations in constant frames, of the points in the world
  std::vector<FreeObservation> free;           // observations in frames that move
  std::vector<Range> fixed_range, free_range;  // by track, in ascending order of the frames

 private:
  int AddPose(const Rigid3d& pose, const PosePrior* prior);
  void AddCalibrations(const PosedImages& posed);
  void AddPriors(const PosedImages& posed);
  void AddDepthMaps(const PosedImages& posed);
  void AddDepths(const PosedImages& posed, const Track& track, double noise_ratio);
  void AddQueryPriors(const PosedImages& posed);
};

}  // namespace lazyloc
