#pragma once

#include <array>
#include <string>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/relative_pose_refinement.h"
#include "colmap_lazyloc/refinement/sampson_refinement.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/structure/track_triangulation.h"
#include "colmap_lazyloc/translation/translation_averaging.h"
#include "colmap_lazyloc/two_view/relative_pose.h"

namespace lazyloc {

// Where bundle adjustment starts from.
enum class StartPose {
  BEST,              // what the score prefers among the others
  MOTION_AVERAGING,  // LazyLoc
  ABSOLUTE_POSE,     // P3P on points that the database images triangulate by themselves
  GENERALIZED_RELATIVE_POSE,
};
template <>
inline constexpr std::array<const char*, 4> kEnumNames<StartPose> = {"best", "motion_averaging", "absolute_pose",
                                                                     "generalized_relative_pose"};

// What follows motion averaging; all but TRACKS are the paper's ablations.
enum class PostOptimization {
  TRACKS,            // triangulation and bundle adjustment
  SAMPSON,           // epipolar errors of the matches
  RELATIVE_POSE_LO,  // relative poses alone (Zhou et al. 2020)
  NONE,
};
template <>
inline constexpr std::array<const char*, 4> kEnumNames<PostOptimization> = {"tracks", "sampson", "relative_pose_lo",
                                                                            "none"};

// Everything that can be set of the method. The one place of every default: the command's help is made from it.
struct LocalizerOptions {
  int seed = 0;
  // Of more pairs than these, the ones with most verified inliers are used; 0 for all.
  int max_num_pairs = 0;
  RelativePoseOptions relative_pose;
  RotationAveragingOptions rotation_averaging;
  TranslationAveragingOptions translation_averaging;
  TrackTriangulationOptions triangulation;
  BundleAdjustmentOptions bundle_adjustment;
  SampsonRefinementOptions sampson;
  RelativePoseRefinementOptions relative_pose_lo;
  StartPose start_pose = StartPose::BEST;
  PostOptimization post_optimization = PostOptimization::TRACKS;

  // A pair whose measured rotation differs from the averaged one by more is dropped.
  double max_rotation_error_deg = 5;
  // Rounds of triangulation and adjustment. The first one starts from motion averaging, which may be off by many
  // pixels.
  int num_refinement_rounds = 3;
  double max_start_error_sigma = 8;  // largest error of a point in the query then, in standard deviations
  // Image noise that the first round assumes; later ones estimate it for each image, but never below the minimum.
  double start_noise_px = 4;
  double min_noise_px = 0.5;
  int min_num_tracks = 6;
  // Of more tracks than these, well distributed ones with most image points are used.
  int max_num_tracks = 1000000;
  // The same for the start and all rounds but the last.
  int max_num_start_tracks = 300;
  // Whether the focal length is sought of a query whose camera has no prior one.
  bool refine_focal_length = false;
  // How far database poses may be off, per axis in degrees and per coordinate of the projection centre in database
  // units: 0 takes them as exact, -1 estimates it for each query from how well the images fit together.
  double database_pose_stddev_deg = -1;
  double database_pose_stddev_length = -1;
  double database_pose_noise_px = 0.1;  // expected size of what is estimated, seen in the image
  // A position whose standard deviation exceeds this part of the distance to the scene is not reported as found.
  double max_position_stddev_ratio = 0.1;

  bool Check(std::string* error) const;
};

}  // namespace lazyloc
