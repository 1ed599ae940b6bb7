#pragma once

#include <array>
#include <string>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

// How a query is localized.
enum class Method {
  EXTENDED,  // the paper's stages with competing starts, repeated refinement, and noise that is estimated
  PAPER,     // LazyLoc as published, for comparison
};
template <>
inline constexpr std::array<const char*, 2> kEnumNames<Method> = {"extended", "paper"};

// The pose that bundle adjustment starts from.
enum class StartPose {
  MOTION_AVERAGING,  // LazyLoc
  ABSOLUTE_POSE,     // P3P on points triangulated from the database images
  GENERALIZED_RELATIVE_POSE,
  DEPTH,  // P3P on points that depth maps of the database images state
};
template <>
inline constexpr std::array<const char*, 4> kEnumNames<StartPose> = {"motion_averaging", "absolute_pose",
                                                                     "generalized_relative_pose", "depth"};

// How the intrinsics of queries are treated. All modes compare them with the images.
enum class IntrinsicsMode {
  AUTO,   // estimates focal lengths that nobody has stated or shares; refuses a query whose given ones are contradicted
  GIVEN,  // keeps them; only warns
  REFINE,  // always estimates the focal length
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<IntrinsicsMode> = {"auto", "given", "refine"};

// Image noise that the start and the first round assume, because motion averaging may be off by many pixels. Later
// rounds estimate it for each image.
inline constexpr double kStartNoisePx = 4;
// Minimum of these estimates, because a few exact matches would otherwise outweigh all others.
inline constexpr double kMinImageNoisePx = 0.5;
// Minimum variance factor of the images in relation to priors: as few points as fix a pose fit it exactly, which says
// nothing of their noise.
inline constexpr double kMinVarianceFactor = 0.01;
// Maximum error of a point in the query in the start and the first round: 8 standard deviations of that noise.
inline constexpr double kMaxStartErrorSigma = 8;
inline constexpr double kMaxStartErrorPx = kMaxStartErrorSigma * kStartNoisePx;

// Minimum number of tracks for a pose: a few more than the six parameters need.
inline constexpr int kMinNumTracks = 6;

// Options of the method. The command's help and options.ini are generated from these defaults.
struct LocalizerOptions {
  int seed = 0;  // of all random choices: the same seed gives the same result
  Method method = Method::EXTENDED;
  TrackTriangulationOptions triangulation;
  BundleAdjustmentOptions bundle_adjustment;

  // Standard deviation of the calibration of a rig, and of the relative poses of a trajectory, as displacement of
  // keypoints by the rotation, and by the position, of each camera in its frame. 0: exact.
  double rig_noise_px = 0.3;
  IntrinsicsMode intrinsics = IntrinsicsMode::AUTO;
  // Standard deviation of the log of a given focal length that is right; 0: exact, so that the covariance leaves it
  // out. Measurements of one camera agree within some tenths of a percent, and focusing changes the focal length by as
  // much.
  double focal_length_stddev_ratio = 0.004;
  // Standard deviation of database poses, per axis in degrees and per coordinate of the projection centre in database
  // units. 0: exact; -1: estimated for each query from how well the images fit together.
  double database_pose_stddev_deg = -1;
  double database_pose_stddev_length = -1;
  bool depth_is_metric = false;  // true: depths are in database units, even if no triangulated point tells
  double min_confidence = 0.9;   // of a pose; a query below it is not LOCALIZED
  // Maximum standard deviation of a position over the distance to the scene; a query above it is not LOCALIZED.
  double max_position_stddev_ratio = 0.1;

  bool Check(std::string* error) const;
};

}  // namespace lazyloc
