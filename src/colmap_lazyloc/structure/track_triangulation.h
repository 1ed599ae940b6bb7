#pragma once

#include <string>
#include <vector>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct TrackTriangulationOptions {
  // Largest distance of a point from an image point of a database view, and of the query, in the view's standard
  // deviations.
  double max_database_error_sigma = 4;
  double max_query_error_sigma = 4;
  // Smallest angle under which the point is seen: by database views alone, and by one of them with the query.
  double min_triangulation_angle_deg = 1.5;
  // Factor on the image noise of a track that one database view sees: that view's pose error moves all such points alike,
  // where the errors of several views average out, and a false match along the epipolar line goes unnoticed.
  double single_view_noise_ratio = 2;

  bool Check(std::string* error) const;
};

// Triangulates each track (COLMAP's linear multi-view triangulation, with those database views that agree with the
// best pair of them) and returns those that hold. Tracks that two or more database views see under a sufficient angle are
// triangulated from these alone, so that an error of the query's present pose does not reach their points; the others
// with the query's ray. Points that lie behind a camera, or too far from an image point, are dropped with their track.
std::vector<Track> TriangulateTracks(const std::vector<View>& views, const std::vector<Track>& tracks,
                                     const TrackTriangulationOptions& options);

// The tracks whose points lie in front of all their views and within max_error_sigma of all their image points, in the
// views' standard deviations.
std::vector<Track> FittingTracks(const std::vector<View>& views, const std::vector<Track>& tracks,
                                 double max_error_sigma);

}  // namespace lazyloc
