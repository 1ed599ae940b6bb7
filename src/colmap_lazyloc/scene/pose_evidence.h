#pragma once

#include <limits>

namespace lazyloc {

// What speaks for the pose of a frame, or against it. NaN if unknown. pipeline/confidence.h makes a probability of it.
struct PoseEvidence {
  // Number of tracks with two or more other images, or with a depth, which fix the pose without its help.
  double num_common_tracks = 0;
  // Share of the verified matches with database images that are in tracks of the pose.
  double explained_ratio = 0;
  // Share of these matches in pairs whose relative pose agrees with the pose.
  double agreeing_ratio = std::numeric_limits<double>::quiet_NaN();
  // Matches in pairs that agree with each other on another pose, over the sum of these and those in agreeing pairs.
  double rival_ratio = std::numeric_limits<double>::quiet_NaN();
  double median_error_px = 0;  // reprojection error of the points in the query
  // Mean reprojection error of the points in the query and in database images, these with their given poses. It tells
  // how much the database would have to move so that all matches fit.
  double mean_error_px = std::numeric_limits<double>::quiet_NaN();
  // Mean number of observations of a point: two of them agree by chance, more hardly ever.
  double mean_track_length = std::numeric_limits<double>::quiet_NaN();
  double position_stddev_ratio = 0;  // along the least certain axis, over scene_distance
  double rotation_stddev_deg = std::numeric_limits<double>::quiet_NaN();
  // rotation_stddev_deg, as a shift at scene_distance, over the position's standard deviation: small if the position is
  // uncertain for other reasons, as along the viewing direction or because of the database poses.
  double rotation_position_ratio = std::numeric_limits<double>::quiet_NaN();
  double start_distance_ratio = 0;  // way of the position from the start to the result, over scene_distance
  double scene_distance = 0;        // median distance of the points
  // Standard deviation of the focal length over it, if it was estimated. A wrong pose takes any focal length.
  double focal_stddev_ratio = std::numeric_limits<double>::quiet_NaN();
};

// Calls visit(name, pointer to the value) for each field.
template <typename Evidence, typename Visit>
void ForEachEvidence(Evidence& e, const Visit& visit) {
  visit("num_common_tracks", &e.num_common_tracks);
  visit("explained_ratio", &e.explained_ratio);
  visit("agreeing_ratio", &e.agreeing_ratio);
  visit("rival_ratio", &e.rival_ratio);
  visit("median_error_px", &e.median_error_px);
  visit("mean_error_px", &e.mean_error_px);
  visit("mean_track_length", &e.mean_track_length);
  visit("position_stddev_ratio", &e.position_stddev_ratio);
  visit("rotation_stddev_deg", &e.rotation_stddev_deg);
  visit("rotation_position_ratio", &e.rotation_position_ratio);
  visit("start_distance_ratio", &e.start_distance_ratio);
  visit("scene_distance", &e.scene_distance);
  visit("focal_stddev_ratio", &e.focal_stddev_ratio);
}

}  // namespace lazyloc
