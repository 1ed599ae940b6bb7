#pragma once

namespace lazyloc {

// Calls `add(name, pointer to the value, help)` for the options of LocalizerOptions that few users need.
template <typename Options, typename Add>
void ForEachMethodOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.rotation_averaging", &o.rotation_averaging,
      "Method of rotation averaging: l1_irls, or for comparison l1 or quaternion_mean");
  add("LazyLocalizer.Advanced.translation_averaging", &o.translation_averaging,
      "Method of translation averaging: angular, or for comparison lud (least unsquared deviations)");
  add("LazyLocalizer.Advanced.start_pose", &o.start_pose,
      "Start of bundle adjustment: best, motion_averaging, absolute_pose, "
      "generalized_relative_pose or depth");
  add("LazyLocalizer.Advanced.post_optimization", &o.post_optimization,
      "Stage after motion averaging: tracks (triangulation and bundle adjustment), or for comparison sampson, "
      "relative_pose_lo or none");
  add("LazyLocalizer.Advanced.rig_noise_px", &o.rig_noise_px,
      "Expected error of the relative poses of a rig or trajectory, as displacement of keypoints. 0: exact");
  add("LazyLocalizer.Advanced.database_pose_stddev_deg", &o.database_pose_stddev_deg,
      "Standard deviation of the database images' rotations in degrees; 0 for both deviations keeps the poses constant, "
      "-1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.database_pose_stddev_length", &o.database_pose_stddev_length,
      "Standard deviation of the database images' positions in database units; 0 for both deviations keeps the poses "
      "constant, -1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.focal_length_stddev_ratio", &o.focal_length_stddev_ratio,
      "Standard deviation of a given focal length, as a fraction of it; 0 leaves it out of the covariance");
}

}  // namespace lazyloc
