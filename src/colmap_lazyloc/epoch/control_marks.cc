#include "colmap_lazyloc/epoch/control_marks.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/joint_adjustment.h"
#include "colmap_lazyloc/bridge/triangulation.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

constexpr double kMaxTriangulationErrorPx = 8;
constexpr double kMinTriangulationAngleDeg = 1.5;  // as in COLMAP's mapper
// Error up to which a mark is not wrong, in medians of all errors: the poses may be off.
constexpr double kMaxMarkErrorRatio = 5;

// Returns the control points with the marks in database images and in photos that are adjusted.
std::vector<JointPoint> PointsInAdjustedImages(const JointScene& scene) {
  std::vector<bool> is_used(scene.images.size(), false);
  for (size_t i = 0; i < is_used.size(); ++i) is_used[i] = scene.images[i].is_database;
  for (const JointPoint& point : scene.points) {
    for (const JointObservation& observation : point.observations) is_used[observation.image] = true;
  }
  std::vector<JointPoint> points = scene.control_points;
  for (JointPoint& point : points) {
    auto& marks = point.observations;
    marks.erase(
        std::remove_if(marks.begin(), marks.end(), [&](const JointObservation& mark) { return !is_used[mark.image]; }),
        marks.end());
  }
  return points;
}

// Returns the place where the rays of the marks meet.
std::optional<Eigen::Vector3d> Intersect(const JointScene& scene, const JointPoint& point) {
  std::vector<Rigid3d> cams_from_world;
  std::vector<Eigen::Vector3d> rays;
  double max_error_rad = 0;
  for (const JointObservation& mark : point.observations) {
    const JointImage& image = scene.images[mark.image];
    const Camera& camera = scene.cameras[image.camera].camera;
    const std::optional<Eigen::Vector3d> ray = RaysInCam(camera)(image.keypoints[mark.keypoint]);
    if (!ray) continue;
    cams_from_world.push_back(image.cam_from_world);
    rays.push_back(*ray);
    max_error_rad = std::max(max_error_rad, kMaxTriangulationErrorPx / MeanFocalLength(camera));
  }
  if (rays.size() < 2) return std::nullopt;
  const auto found = TriangulateTrack(cams_from_world, rays, max_error_rad, DegToRad(kMinTriangulationAngleDeg));
  return found ? std::make_optional(found->point_in_world) : std::nullopt;
}

// Returns the vectors from where points were surveyed to where the rays of their marks meet.
std::vector<Eigen::Vector3d> ShiftsFromSurvey(const JointScene& scene, const std::vector<JointPoint>& points) {
  std::vector<Eigen::Vector3d> shifts;
  for (const JointPoint& point : points) {
    const std::optional<Eigen::Vector3d> place = Intersect(scene, point);
    if (place) shifts.emplace_back(*place - point.survey->place);
  }
  return shifts;
}

// Returns the median of each coordinate.
Eigen::Vector3d MedianOf(const std::vector<Eigen::Vector3d>& shifts) {
  Eigen::Vector3d median = Eigen::Vector3d::Zero();
  for (int k = 0; k < 3 && !shifts.empty(); ++k) {
    std::vector<double> values;
    for (const Eigen::Vector3d& shift : shifts) values.push_back(shift[k]);
    median[k] = Median(std::move(values));
  }
  return median;
}

}  // namespace

ControlMarks FindFittingMarks(const JointScene& scene) {
  ControlMarks marks;
  marks.points = PointsInAdjustedImages(scene);
  const std::vector<Eigen::Vector3d> shifts = ShiftsFromSurvey(scene, marks.points);
  const Eigen::Vector3d shift = MedianOf(shifts);
  std::vector<double> distances;
  for (const Eigen::Vector3d& each : shifts) distances.push_back(each.norm());
  if (!distances.empty()) marks.median_distance = Median(std::move(distances));
  std::vector<double> errors_px;
  for (JointPoint& point : marks.points) {
    point.point_in_world = point.survey->place + shift;
    for (const JointObservation& mark : point.observations) {
      errors_px.push_back(ReprojectionErrorPx(scene, point, mark));
    }
  }
  const double median_px = errors_px.empty() ? 0 : Median(errors_px);
  auto error_px = errors_px.begin();
  for (size_t i = 0; i < marks.points.size(); ++i) {
    JointPoint& point = marks.points[i];
    const double bound_px = std::max(kMaxMarkErrorSigma * point.survey->mark_noise_px, kMaxMarkErrorRatio * median_px);
    std::vector<JointObservation> fitting;
    for (const JointObservation& mark : point.observations) {
      if (std::isfinite(*error_px) && *error_px <= bound_px) {
        fitting.push_back(mark);
      } else {
        marks.wrong.push_back({i, mark.image, *error_px});
      }
      ++error_px;
    }
    point.observations = std::move(fitting);
  }
  return marks;
}

bool FitAdjustedScene(const ControlMarks& marks, const JointScene& scene) {
  std::vector<double> errors_sigma;
  for (const JointPoint& point : marks.points) {
    for (const JointObservation& mark : point.observations) {
      errors_sigma.push_back(ReprojectionErrorPx(scene, point, mark) / point.survey->mark_noise_px);
    }
  }
  return !errors_sigma.empty() && Median(std::move(errors_sigma)) <= kMaxMarkErrorSigma;
}

}  // namespace lazyloc
