#include "colmap_lazyloc/group/rig_check.h"

#include <algorithm>
#include <limits>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {
namespace {

std::string MisfitReason(const Layout& layout, int query) {
  return "image " + layout.names[query] +
         " does not fit its place in the rig: the rig's calibration (or the trajectory) is wrong; see "
         "--LazyLocalizer.Advanced.use_rigs 0";
}

// An observation of a query with the point of its track.
struct RayToPoint {
  Observation observation;
  Eigen::Vector3d point_in_world;
};

// Returns the reprojection errors; infinity for points behind the image.
std::vector<double> ErrorsPx(const Rigid3d& cam_from_world, const std::vector<RayToPoint>& rays) {
  std::vector<double> errors_px;
  for (const auto& [observation, point] : rays) {
    const Eigen::Vector3d point_in_cam = cam_from_world * point;
    errors_px.push_back(IsInFront(observation, point_in_cam) ? ReprojectionError(observation, point_in_cam).norm()
                                                             : std::numeric_limits<double>::infinity());
  }
  return errors_px;
}

// Returns true if most of the points fit some pose of the image, and less than half as many the pose that its frame
// gives it. errors_px: by that.
bool FitsBetterAlone(const Layout& layout, int query, const std::vector<RayToPoint>& rays,
                     const std::vector<double>& errors_px, const LocalizerOptions& options) {
  if (static_cast<int>(rays.size()) < 2 * kMinNumTracks) return false;
  // Takes half the bound of the start, because a good trajectory may still be off by some pixels.
  const double max_error_px = kMaxStartErrorPx / 2;
  std::vector<Eigen::Vector3d> rays_in_cam, points;
  for (const auto& [observation, point] : rays) {
    rays_in_cam.push_back(observation.ray_in_cam);
    points.push_back(point);
  }
  const uint32_t seed = SeedFromNames(layout.names[query], "", options.seed);
  const std::optional<Rigid3d> alone =
      EstimateAbsolutePose(rays_in_cam, points, max_error_px / 2 * RadFromPx(rays.front().observation), seed, 0.1);
  if (!alone) return false;
  const auto num_fitting = [&](const std::vector<double>& errors) {
    return std::count_if(errors.begin(), errors.end(), [&](double error_px) { return error_px <= max_error_px; });
  };
  const auto num_alone = num_fitting(ErrorsPx(*alone, rays));
  return 2 * num_alone >= static_cast<std::ptrdiff_t>(rays.size()) && 2 * num_fitting(errors_px) < num_alone;
}

bool AreAtOnePoint(const Layout& layout, const std::vector<int>& queries) {
  return std::all_of(queries.begin(), queries.end(),
                     [&](int query) { return CamInWorld(layout.given.images[query].cam_from_frame).isZero(); });
}

// Returns true if the image's own pairs agree with each other on a rotation.
bool AgreeAlone(const RotationAveragingProblem& alone, double max_error_rad) {
  if (alone.edges.size() < 2) return false;
  size_t num_agreeing = 0;
  for (const double error_rad : AverageRotations(alone).edge_errors_rad) {
    num_agreeing += error_rad <= max_error_rad;
  }
  return num_agreeing >= 2 && 2 * num_agreeing > alone.edges.size();
}

}  // namespace

std::vector<std::optional<double>> CheckRigs(const Layout& layout, const PosedImages& posed,
                                             const std::vector<Track>& tracks_from_database,
                                             const LocalizerOptions& options) {
  std::vector<std::optional<double>> errors_px(layout.num_queries);
  Failure failure{QueryStatus::INCONSISTENT_RIG, ""};
  std::vector<std::vector<RayToPoint>> rays(layout.num_queries);
  if (layout.num_query_frames == layout.num_queries) return errors_px;  // single images
  for (const Track& track : tracks_from_database) {
    for (const TrackObservation& element : track.observations) {
      if (layout.IsDatabase(element.image)) break;
      rays[element.image].push_back({element.observation, track.point_in_world});
    }
  }
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const std::vector<int>& queries = layout.QueriesOf(frame);
    if (queries.size() == 1) continue;
    for (const int query : queries) {
      const std::vector<double> of_query_px = ErrorsPx(CamFromWorld(posed, query), rays[query]);
      if (!of_query_px.empty()) errors_px[query] = Median(of_query_px);
      if (!FitsBetterAlone(layout, query, rays[query], of_query_px, options)) continue;
      failure.Add(frame, MisfitReason(layout, query));
      break;
    }
  }
  failure.rig_errors_px = errors_px;
  if (!failure.frames.empty()) throw failure;
  return errors_px;
}

void CheckRigRotations(const Layout& layout, const PairRefs& pairs, const std::vector<double>& rotation_errors_rad,
                       double max_error_deg) {
  if (layout.num_query_frames == layout.num_queries) return;  // single images
  const double max_error_rad = DegToRad(max_error_deg);
  std::vector<RotationAveragingProblem> alone(layout.num_queries);
  std::vector<size_t> num_agreeing(layout.num_queries, 0);
  for (RotationAveragingProblem& problem : alone) {
    problem.rotations = {Eigen::Quaterniond::Identity()};
    problem.is_fixed = {false};
  }
  for (size_t i = 0; i < pairs.size(); ++i) {
    const PairGeometry& pair = *pairs[i];
    if (!layout.IsDatabase(pair.other)) continue;
    num_agreeing[pair.query] += rotation_errors_rad[i] <= max_error_rad;
    RotationAveragingProblem& problem = alone[pair.query];
    problem.edges.push_back({static_cast<int>(problem.rotations.size()), 0, pair.query_from_other.rotation,
                             static_cast<double>(pair.num_inliers)});
    problem.rotations.push_back(CamFromWorld(layout.given, pair.other).rotation);
    problem.is_fixed.push_back(true);
  }
  CheckFrames(layout.num_query_frames, QueryStatus::INCONSISTENT_RIG, [&](int frame) {
    const std::vector<int>& queries = layout.QueriesOf(frame);
    // Leaves out faces of a panorama: their calibration is right, but a plane may have a wrong rotation in several
    // pairs.
    if (queries.size() == 1 || AreAtOnePoint(layout, queries)) return Reason();
    for (const int query : queries) {
      if (num_agreeing[query] == 0 && AgreeAlone(alone[query], max_error_rad)) {
        return Reason(MisfitReason(layout, query));
      }
    }
    return Reason();
  });
}

}  // namespace lazyloc
