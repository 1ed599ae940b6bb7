#pragma once

#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct TrackTriangulationOptions {
  // Maximum distance of a point from a keypoint in a query, in standard deviations of the image's noise. For database
  // images it is always four.
  double max_query_error_sigma = 4;
  // Minimum angle between two rays of a point.
  double min_triangulation_angle_deg = 1.5;
  // Factor on the image noise of tracks that the database sees from one direction only, in one image for example: its
  // pose error moves all their points alike, where the errors of several images average out, and a false match along
  // the epipolar line goes unnoticed.
  double single_image_noise_ratio = 3;

  bool Check(std::string* error) const;
};

// Tracks with points, and the others.
struct SplitTracks {
  std::vector<Track> from_database;
  std::vector<Track> rest;
};

// Triangulates tracks that two or more database images see under a sufficient angle, from these images alone, so that
// an error of the queries' poses does not reach the points. Removes the database observations that disagree with most
// of the others. All other tracks, which only a query pose can triangulate, go to `rest`.
SplitTracks TriangulateFromDatabase(const PosedImages& posed, std::vector<Track> tracks,
                                    const TrackTriangulationOptions& options);

// Triangulates tracks that the database sees from one direction, or of queries in several frames alone, with the
// queries' rays. Leaves out tracks whose database images disagree.
std::vector<Track> TriangulateWithQuery(const PosedImages& posed, std::vector<Track> tracks,
                                        const TrackTriangulationOptions& options);

// Removes observations in queries whose points lie behind the camera or farther away than max_error_sigma standard
// deviations of the query or of the track's database images, whichever are larger. Removes tracks that are left without
// observations in queries or with a single one. Keeps the order.
std::vector<Track> RemoveQueryOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma);

// Does the same by each image's own noise, and removes tracks with such an observation in a database image.
std::vector<Track> RemoveOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma);

}  // namespace lazyloc
