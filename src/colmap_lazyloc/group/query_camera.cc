#include "colmap_lazyloc/group/query_camera.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Number of iterations after which observations are linearised anew. With more of them, a focal length that the images
// hardly determine moves to where the linearisation no longer holds, and back in the next adjustment.
constexpr int kMaxNumIterations = 5;
// Changes of the log of the focal length and of the image's corners up to which they have settled, and the number of
// adjustments they get for that.
constexpr double kMaxLogFocalChange = 1e-3;
constexpr double kMaxCornerChangePx = 0.1;
constexpr int kMaxNumAdjustments = 20;

}  // namespace

QueryCamera::QueryCamera(const LocalizationProblem& problem)
    : problem_(&problem),
      camera_(IsCalibrated(problem.intrinsics_origin) ? problem.query_camera
                                                      : WithAllCorrections(problem.query_camera)) {}

void QueryCamera::ScaleFocalLength(double factor) {
  camera_ = WithFocalFactor(camera_, factor);
  focal_factor_ *= factor;
}

OtherCorrections QueryCamera::Corrections() const {
  return CorrectionsBetween(WithAllCorrections(problem_->query_camera), camera_).tail<kNumOtherCorrections>();
}

double QueryCamera::Correct(BundleAdjustmentResult* adjustment) {
  if (IsCalibrated(problem_->intrinsics_origin)) return 0;
  const IntrinsicsScore& score = adjustment->intrinsics_scores.front();
  const OtherCorrections made = Corrections();
  const OtherCorrections change =
      UncalibratedCorrections(score, score.common_error_factor, made, camera_, problem_->intrinsics_origin).mean - made;
  IntrinsicsCorrections with_focal_length;
  with_focal_length << 0, change;
  camera_ = Corrected(camera_, with_focal_length);
  const Eigen::Matrix<double, 6, 1> move = score.frame_from_correction.rightCols<kNumOtherCorrections>() * change;
  Rigid3d& pose = adjustment->posed.frames[0].frame_from_world;
  pose = {ExpSO3(move.head<3>()) * pose.rotation, pose.translation + move.tail<3>()};
  ScaleFocalLength(std::exp(score.log_factor_from_correction.tail<kNumOtherCorrections>().dot(change)));
  return CornerDisplacementPx(with_focal_length, camera_);
}

std::vector<Track> QueryCamera::Observe(const std::vector<Track>& tracks) const {
  const Observer observe(camera_);
  std::vector<Track> observed;
  for (const Track& track : tracks) {
    const std::optional<Observation> query = observe(problem_->query_keypoints[track.observations.front().keypoint]);
    if (!query) continue;
    observed.push_back(track);
    observed.back().observations.front().observation = *query;
  }
  return observed;
}

std::vector<Track> QueryCamera::ObserveAtPoints(const PosedImages& posed, std::vector<Track> tracks) const {
  const Observer observe(camera_);
  const Rigid3d cam_from_world = CamFromWorld(posed, 0);
  for (Track& track : tracks) {
    TrackObservation& query = track.observations.front();
    const std::optional<Eigen::Vector2d> projection = ImageFromCam(camera_, cam_from_world * track.point_in_world);
    std::optional<Observation> observation = projection ? observe(*projection) : std::nullopt;
    if (!observation) continue;
    const Eigen::Vector2d error = *projection - problem_->query_keypoints[query.keypoint];
    observation->px_from_cam += error * observation->ray_in_cam.transpose();
    query.observation = *observation;
  }
  return tracks;
}

BundleAdjustmentResult QueryCamera::Adjust(PosedImages posed, std::vector<Track> tracks,
                                           BundleAdjustmentOptions options) {
  options.max_num_iterations = std::min(options.max_num_iterations, kMaxNumIterations);
  BundleAdjustmentResult result;
  result.posed = std::move(posed);
  result.tracks = ObserveAtPoints(result.posed, std::move(tracks));
  options.computes_covariances |= !IsCalibrated(problem_->intrinsics_origin);
  double change = 0, corner_change_px = 0;
  int num_adjustments = 0;
  do {
    result = AdjustBundle(result.posed, std::move(result.tracks), options);
    if (!result.summary.success) return result;
    change = *result.posed.images[0].log_focal_factor;
    ScaleFocalLength(std::exp(change));
    corner_change_px = Correct(&result);
    result.posed.images[0].log_focal_factor = 0;
    result.tracks = ObserveAtPoints(result.posed, Observe(result.tracks));
  } while ((std::abs(change) > kMaxLogFocalChange || corner_change_px > kMaxCornerChangePx) &&
           ++num_adjustments < kMaxNumAdjustments);
  return result;
}

}  // namespace lazyloc
