#pragma once

#include <limits>

namespace lazyloc {

// What speaks for the pose of a frame, or against it. NaN if unknown. uncertainty/confidence.h makes a probability of
// it.
struct PoseEvidence {
  // Number of tracks with two or more other images, or with a depth, which fix the pose without its help.
  double num_common_tracks = 0;
  double num_single_tracks = 0;  // the others, seen from one other direction
  // Share of the verified matches with database images that are in tracks of the pose.
  double explained_ratio = std::numeric_limits<double>::quiet_NaN();
  // Score of the pose that competes most over that of the pose (starts/competing_pose.h); 0 without any.
  double competing_ratio = 0;
  double median_error_px = 0;        // reprojection error of the points in the query
  double position_stddev_ratio = 0;  // along the least certain axis, over scene_distance
  double scene_distance = 0;         // median distance of the points
};

// Calls visit(name, pointer to the value) for each field.
template <typename Evidence, typename Visit>
void ForEachEvidence(Evidence& e, const Visit& visit) {
  visit("num_common_tracks", &e.num_common_tracks);
  visit("num_single_tracks", &e.num_single_tracks);
  visit("explained_ratio", &e.explained_ratio);
  visit("competing_ratio", &e.competing_ratio);
  visit("median_error_px", &e.median_error_px);
  visit("position_stddev_ratio", &e.position_stddev_ratio);
  visit("scene_distance", &e.scene_distance);
}

}  // namespace lazyloc
