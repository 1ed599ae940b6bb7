#include "colmap_lazyloc/structure/track_triangulation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "colmap_lazyloc/bridge/triangulation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// Error of a point in one view, in its standard deviations; infinite behind it.
double NormalizedError(const View& view, const Observation& observation, const Eigen::Vector3d& point_in_world) {
  const Eigen::Vector3d point_in_cam = view.cam_from_world * point_in_world;
  if (!IsInFront(observation, point_in_cam)) return std::numeric_limits<double>::infinity();
  return ReprojectionError(observation, point_in_cam).norm() / view.noise_px;
}

class TrackTriangulator {
 public:
  TrackTriangulator(const std::vector<View>& views, const TrackTriangulationOptions& options)
      : views_(views), options_(options), max_cos_angle_(std::cos(DegToRad(options.min_triangulation_angle_deg))) {
    for (const View& view : views) {
      Eigen::Matrix<double, 3, 4> matrix;
      matrix << view.cam_from_world.rotation.toRotationMatrix(), view.cam_from_world.translation;
      cams_from_world_.push_back(matrix);
      cams_in_world_.push_back(CamInWorld(view.cam_from_world));
    }
  }

  std::optional<Track> FromDatabase(const Track& track) const {
    std::vector<TrackObservation> query, database;
    for (const TrackObservation& observation : track.observations) {
      (views_[observation.view].is_database ? database : query).push_back(observation);
    }
    Track result;
    if (!TriangulateRobustly(&database, &result.point_in_world)) return std::nullopt;
    result.observations = std::move(query);
    result.observations.insert(result.observations.end(), database.begin(), database.end());
    return result;
  }

  std::optional<Track> WithQuery(const Track& track) const {
    const auto is_database = [&](const TrackObservation& element) { return views_[element.view].is_database; };
    if (std::count_if(track.observations.begin(), track.observations.end(), is_database) != 1) return std::nullopt;
    Track result = track;
    result.noise_ratio = options_.single_view_noise_ratio;
    if (!Linear(track.observations, &result.point_in_world)) return std::nullopt;
    if (!SeenUnderAngle(track.observations, result.point_in_world)) return std::nullopt;
    const bool fits = std::all_of(track.observations.begin(), track.observations.end(), [&](const auto& element) {
      return NormalizedError(views_[element.view], element.observation, result.point_in_world) <=
             options_.max_query_error_sigma;
    });
    return fits ? std::optional<Track>(result) : std::nullopt;
  }

 private:
  bool Linear(const std::vector<TrackObservation>& observations, Eigen::Vector3d* point) const {
    std::vector<Eigen::Matrix<double, 3, 4>> cams_from_world;
    std::vector<Eigen::Vector3d> rays_in_cam;
    for (const TrackObservation& observation : observations) {
      cams_from_world.push_back(cams_from_world_[observation.view]);
      rays_in_cam.push_back(observation.observation.ray_in_cam);
    }
    const std::optional<Eigen::Vector3d> triangulated = TriangulatePoint(cams_from_world, rays_in_cam);
    if (triangulated) *point = *triangulated;
    return triangulated.has_value();
  }

  bool SeenUnderAngle(const std::vector<TrackObservation>& observations, const Eigen::Vector3d& point) const {
    for (size_t a = 0; a < observations.size(); ++a) {
      const Eigen::Vector3d ray_a = (point - cams_in_world_[observations[a].view]).normalized();
      for (size_t b = 0; b < a; ++b) {
        if (ray_a.dot((point - cams_in_world_[observations[b].view]).normalized()) < max_cos_angle_) return true;
      }
    }
    return false;
  }

  // All views where they agree, else those that agree with the best of the views' pairs.
  bool TriangulateRobustly(std::vector<TrackObservation>* observations, Eigen::Vector3d* point) const {
    if (observations->size() < 2 || !Linear(*observations, point)) return false;
    if (!AllAgree(*observations, *point)) {
      *observations = BestAgreeingViews(*observations);
      if (observations->size() < 2 || !Linear(*observations, point) || !AllAgree(*observations, *point)) return false;
    }
    return SeenUnderAngle(*observations, *point);
  }

  bool AllAgree(const std::vector<TrackObservation>& observations, const Eigen::Vector3d& point) const {
    return std::all_of(observations.begin(), observations.end(),
                       [&](const TrackObservation& element) { return Agrees(element, point); });
  }

  bool Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const {
    return NormalizedError(views_[element.view], element.observation, point) <= options_.max_database_error_sigma;
  }

  std::vector<TrackObservation> BestAgreeingViews(const std::vector<TrackObservation>& observations) const {
    std::vector<TrackObservation> best;
    for (size_t a = 0; a < observations.size(); ++a) {
      for (size_t b = 0; b < a; ++b) {
        Eigen::Vector3d point;
        const std::vector<TrackObservation> pair = {observations[a], observations[b]};
        if (!Linear(pair, &point) || !SeenUnderAngle(pair, point)) continue;
        std::vector<TrackObservation> agreeing;
        for (const TrackObservation& element : observations) {
          if (Agrees(element, point)) agreeing.push_back(element);
        }
        if (agreeing.size() > best.size()) best = std::move(agreeing);
      }
    }
    return best;
  }

  const std::vector<View>& views_;
  const TrackTriangulationOptions& options_;
  const double max_cos_angle_;
  std::vector<Eigen::Matrix<double, 3, 4>> cams_from_world_;
  std::vector<Eigen::Vector3d> cams_in_world_;
};

std::vector<Track> TracksThatFit(const std::vector<View>& views, const std::vector<Track>& tracks,
                                 double max_error_sigma, bool also_in_database) {
  std::vector<Track> fitting;
  for (const Track& track : tracks) {
    const bool fits = std::all_of(track.observations.begin(), track.observations.end(), [&](const auto& element) {
      const View& view = views[element.view];
      if (view.is_database && !also_in_database) return true;
      return NormalizedError(view, element.observation, track.point_in_world) <= max_error_sigma;
    });
    if (fits) fitting.push_back(track);
  }
  return fitting;
}

}  // namespace

bool TrackTriangulationOptions::Check(std::string* error) const {
  OPTION_GT(max_database_error_sigma, 0);
  OPTION_GT(max_query_error_sigma, 0);
  OPTION_GE(min_triangulation_angle_deg, 0);
  OPTION_GT(single_view_noise_ratio, 0);
  return true;
}

std::vector<Track> TriangulateFromDatabase(const std::vector<View>& views, const std::vector<Track>& tracks,
                                           const TrackTriangulationOptions& options, std::vector<Track>* rest) {
  const TrackTriangulator triangulator(views, options);
  std::vector<Track> triangulated;
  rest->clear();
  for (const Track& track : tracks) {
    std::optional<Track> result = triangulator.FromDatabase(track);
    if (result) {
      triangulated.push_back(std::move(*result));
    } else {
      rest->push_back(track);
    }
  }
  return triangulated;
}

std::vector<Track> TriangulateWithQuery(const std::vector<View>& views, const std::vector<Track>& tracks,
                                        const TrackTriangulationOptions& options) {
  const TrackTriangulator triangulator(views, options);
  std::vector<Track> triangulated;
  for (const Track& track : tracks) {
    std::optional<Track> result = triangulator.WithQuery(track);
    if (result) triangulated.push_back(std::move(*result));
  }
  return triangulated;
}

std::vector<Track> TracksFittingQuery(const std::vector<View>& views, const std::vector<Track>& tracks,
                                      double max_error_sigma) {
  return TracksThatFit(views, tracks, max_error_sigma, /*also_in_database=*/false);
}

std::vector<Track> FittingTracks(const std::vector<View>& views, const std::vector<Track>& tracks,
                                 double max_error_sigma) {
  return TracksThatFit(views, tracks, max_error_sigma, /*also_in_database=*/true);
}

}  // namespace lazyloc
