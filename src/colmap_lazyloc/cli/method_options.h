#pragma once

namespace lazyloc {

template <typename Options, typename Add>
void ForEachDepthOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.depth_has_shift", &o.depth.has_shift,
      "Fit a constant that is added to all depths of a map, beside its scale");
  add("LazyLocalizer.Advanced.depth_stddev_ratio", &o.depth.min_stddev_ratio,
      "Minimum standard deviation of a depth, as a fraction of it; the depths' scatter around triangulated points may "
      "show a larger one");
  add("LazyLocalizer.Advanced.depth_scale_stddev_ratio", &o.depth.metric_stddev_ratio,
      "Standard deviation of the scale of metric depth maps, as a fraction of it");
}

// Calls `add(name, pointer to the value, help)` for the options of LocalizerOptions that few users need.
template <typename Options, typename Add>
void ForEachMethodOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.min_num_inliers", &o.relative_pose.min_num_inliers,
      "Minimum number of verified inliers of a pair");
  add("LazyLocalizer.Advanced.max_two_view_error_px", &o.relative_pose.max_two_view_error_px,
      "Maximum epipolar error of an inlier in pixels, for pairs without a stored two-view geometry");
  add("LazyLocalizer.Advanced.rotation_averaging", &o.rotation_averaging.method,
      "Method of rotation averaging: l1_irls, or for comparison l1 or quaternion_mean");
  add("LazyLocalizer.Advanced.max_rotation_error_deg", &o.max_rotation_error_deg,
      "Maximum difference in degrees between the measured and the averaged rotation of a pair");
  add("LazyLocalizer.Advanced.translation_averaging", &o.translation_averaging.method,
      "Method of translation averaging: angular, or for comparison lud (least unsquared deviations)");
  add("LazyLocalizer.Advanced.start_pose", &o.start_pose,
      "Start of bundle adjustment: best, motion_averaging, absolute_pose, "
      "generalized_relative_pose or depth");
  add("LazyLocalizer.Advanced.post_optimization", &o.post_optimization,
      "Stage after motion averaging: tracks (triangulation and bundle adjustment), or for comparison sampson, "
      "relative_pose_lo or none");
  add("LazyLocalizer.Advanced.min_triangulation_angle_deg", &o.triangulation.min_triangulation_angle_deg,
      "Minimum angle in degrees between the rays to a point");
  add("LazyLocalizer.Advanced.max_query_error_sigma", &o.triangulation.max_query_error_sigma,
      "Maximum reprojection error of a point in the query, in standard deviations of the image noise");
  add("LazyLocalizer.Advanced.single_image_noise_ratio", &o.triangulation.single_image_noise_ratio,
      "Factor on the image noise of points with one database image; it grows if these scatter more than others");
  add("LazyLocalizer.Advanced.num_refinement_rounds", &o.num_refinement_rounds,
      "Number of rounds of triangulation and bundle adjustment");
  add("LazyLocalizer.Advanced.convergence_sigma", &o.bundle_adjustment.convergence_sigma,
      "Bundle adjustment ends when a step moves the poses by less than this, in standard deviations");
  add("LazyLocalizer.Advanced.max_num_tracks", &o.max_num_tracks, "Maximum number of tracks in the last round");
  add("LazyLocalizer.Advanced.max_num_start_tracks", &o.max_num_start_tracks,
      "Maximum number of tracks for the start pose and in all rounds but the last");
  add("LazyLocalizer.Advanced.rig_noise_px", &o.rig_noise_px,
      "Expected error of the relative poses of a rig or trajectory, as displacement of keypoints. 0: exact");
  add("LazyLocalizer.Advanced.database_pose_stddev_deg", &o.database_pose_stddev_deg,
      "Standard deviation of the database images' rotations in degrees; 0 for both deviations keeps the poses constant, "
      "-1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.database_pose_stddev_length", &o.database_pose_stddev_length,
      "Standard deviation of the database images' positions in database units; 0 for both deviations keeps the poses "
      "constant, -1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.database_pose_noise_px", &o.database_pose_noise_px,
      "Expected difference of pose errors, in pixels, between viewpoints 11.5 degrees or a fifth of the distance to the "
      "scene apart, for the estimates of -1; -1: 0.7, or for a query with one or two database images what matches "
      "among database images show");
  add("LazyLocalizer.Advanced.focal_length_stddev_ratio", &o.focal_length_stddev_ratio,
      "Standard deviation of a given focal length, as a fraction of it; 0 leaves it out of the covariance");
  ForEachDepthOption(o, add);
  add("LazyLocalizer.Advanced.min_num_tracks", &o.min_num_tracks, "Minimum number of tracks for a pose");
  add("LazyLocalizer.Advanced.max_position_stddev_ratio", &o.max_position_stddev_ratio,
      "Maximum standard deviation of a position, as a fraction of the distance to the scene");
}

}  // namespace lazyloc
