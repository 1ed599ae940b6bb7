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
  // Factor on the image noise of a track that one database view sees: that view's pose error moves all such points
  // alike, where the errors of several views average out, and a false match along the epipolar line goes unnoticed.
  double single_view_noise_ratio = 2;

  bool Check(std::string* error) const;
};

// Tracks that two or more database views see under a sufficient angle, triangulated from these alone (where their
// rays meet best, with those views that agree with the best pair of them): an error of the query's present
// pose does not reach their points. The other tracks, which only a query pose can triangulate, go to `rest`.
std::vector<Track> TriangulateFromDatabase(const std::vector<View>& views, std::vector<Track> tracks,
                                           const TrackTriangulationOptions& options, std::vector<Track>* rest);

// Tracks that one database view sees, or none but queries that move independently, triangulated with the queries' rays.
// Tracks whose several database views do not agree are left out, as nothing tells which of them to believe.
std::vector<Track> TriangulateWithQuery(const std::vector<View>& views, std::vector<Track> tracks,
                                        const TrackTriangulationOptions& options);

// The tracks without those image points in query views that their points lie behind of, or farther away than
// max_error_sigma, in the views' standard deviations; tracks of which none remains in a query are left out.
std::vector<Track> TracksFittingQuery(const std::vector<View>& views, std::vector<Track> tracks,
                                      double max_error_sigma);

// The same, without tracks that database views contradict.
std::vector<Track> FittingTracks(const std::vector<View>& views, std::vector<Track> tracks, double max_error_sigma);

}  // namespace lazyloc
