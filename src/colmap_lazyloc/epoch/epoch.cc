#include "colmap_lazyloc/epoch/epoch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "colmap_lazyloc/bridge/joint_adjustment.h"
#include "colmap_lazyloc/epoch/adjustment_rounds.h"
#include "colmap_lazyloc/epoch/epoch_cameras.h"
#include "colmap_lazyloc/epoch/epoch_scene.h"
#include "colmap_lazyloc/epoch/hanging.h"
#include "colmap_lazyloc/scene/equirectangular.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

constexpr int kMaxNumHangings = 10;  // the length of a chain of photos
// Shift by adjustment, in standard deviations of the pose before, above which a photo that hangs on others was wrong.
constexpr double kMaxShiftSigma = 5;
constexpr int kMaxNumNames = 3;  // in a line
// Factor on the covariances of adjusted photos. Errors that many points of all photos share, as by a rolling shutter or
// by the camera model, do not make the photos disagree, so that the adjustment does not see them.
constexpr double kUnmodelledErrorFactor = 4;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// True if the photo can be adjusted with others: it has keypoints, and a camera that is not spherical.
bool CanBeAdjusted(const DatabaseReader& database, const DatabaseImage& image) {
  try {
    return !IsEquirectangular(database.ReadCamera(image.camera_id)) &&
           !database.ReadKeypointsOnce(image.image_id).empty();
  } catch (const DamagedRecordError&) {
    return false;
  }
}

std::vector<EpochPhoto> MakePhotos(std::vector<LocalizationResult> localized, const DatabaseReader& database) {
  const std::vector<DatabaseImage> images = database.ReadImages();
  std::vector<EpochPhoto> photos;
  for (LocalizationResult& result : localized) {
    EpochPhoto photo;
    const DatabaseImage* image = FindByName(images, result.query_name);
    if (image != nullptr && CanBeAdjusted(database, *image)) {
      photo.database_id = image->image_id;
      photo.is_placed = result.status == QueryStatus::LOCALIZED;
      photo.localized = MakePoseDistribution(result.cam_from_world, result.covariance);
      photo.record.epoch = EpochResult();
    }
    photo.record.result = std::move(result);
    photos.push_back(std::move(photo));
  }
  return photos;
}

// Takes over poses, covariances and cameras.
void TakeAdjusted(const EpochScene& epoch, const AdjustedPhotos& adjusted, std::vector<EpochCamera>* cameras,
                  std::vector<EpochPhoto>* photos) {
  for (size_t i = 0; i < cameras->size(); ++i) (*cameras)[i].camera = epoch.scene.cameras[i].camera;
  for (size_t i = 0; i < epoch.photos.size(); ++i) {
    EpochPhoto& photo = (*photos)[epoch.photos[i]];
    LocalizationResult& result = photo.record.result;
    const Rigid3d& relative = epoch.scene.images[i].cam_from_world;
    photo.record.epoch->is_adjusted = adjusted.covariances[i].allFinite();
    if (!photo.record.epoch->is_adjusted) continue;  // it keeps its pose
    result.cam_from_world = RelativeTo(-epoch.origin, relative);
    photo.record.epoch->shift = (CamInWorld(result.cam_from_world) - CamInWorld(photo.localized.cam_from_world)).norm();
    PoseDistribution pose = MakePoseDistribution(relative, kUnmodelledErrorFactor * adjusted.covariances[i]);
    result.covariance = pose.CovarianceAt(result.cam_from_world.translation);
    result.spread = pose.Spread();
    const EpochCamera& camera = (*cameras)[photo.camera];
    const uint32_t camera_id = result.query_camera.camera_id;
    result.query_camera = camera.camera;
    result.query_camera.camera_id = camera_id;
    if (!camera.is_constant) {
      result.is_camera_refined = true;
      result.intrinsics.verdict = IntrinsicsVerdict::REFINED;
    }
  }
}

// Adjusts a scene, and takes over what comes of it.
AdjustedPhotos Adjust(const std::function<void(const std::string&)>& report, EpochScene* epoch,
                      std::vector<EpochCamera>* cameras, std::vector<EpochPhoto>* photos) {
  AdjustedPhotos adjusted = AdjustInRounds(&epoch->scene);
  report(Format("adjusted %d photos with %d database images and %d points: %s", static_cast<int>(epoch->photos.size()),
                static_cast<int>(epoch->scene.images.size() - epoch->photos.size()),
                static_cast<int>(epoch->scene.points.size()), adjusted.summary.message.c_str()));
  if (adjusted.summary.success) {
    TakeAdjusted(*epoch, adjusted, cameras, photos);
  } else {
    for (const int photo : epoch->photos) (*photos)[photo].record.epoch->is_adjusted = false;
  }
  return adjusted;
}

// Returns true if adjustment has moved a photo by more than its localization lets expect.
bool IsContradicted(const EpochPhoto& photo) {
  const Eigen::Vector3d shift = CamInWorld(photo.Pose()) - CamInWorld(photo.localized.cam_from_world);
  const Eigen::Matrix3d covariance = photo.localized.PositionCovariance();
  return shift.dot(covariance.ldlt().solve(shift)) > 3 * kMaxShiftSigma * kMaxShiftSigma;
}

// Takes their poses from photos that hang on others if adjustment contradicts these, or could not adjust the photos:
// only adjustment takes into account how uncertain the others are. Returns how many there were.
int RemoveUnconfirmed(std::vector<EpochPhoto>* photos) {
  int num_removed = 0;
  for (EpochPhoto& photo : *photos) {
    if (!photo.is_placed || !photo.refused) continue;
    if (photo.record.epoch->is_adjusted && !IsContradicted(photo)) continue;
    photo.record = std::move(*photo.refused);
    photo.refused.reset();
    photo.is_placed = false;
    ++num_removed;
  }
  return num_removed;
}

// Gives the photos of a scene the pairs and the points of the last adjustment.
class PointsAdder {
 public:
  PointsAdder(const EpochScene& epoch, std::vector<EpochPhoto>* photos)
      : epoch_(epoch),
        photos_(*photos),
        num_photos_(static_cast<int>(epoch.photos.size())),
        pair_of_image_(epoch.photos.size()) {}

  void AddAll() {
    for (int i = 0; i < num_photos_; ++i) Clear(&ResultOf(i));
    AddPairs();
    for (const JointPoint& point : epoch_.scene.points) AddPoint(point);
    for (int i = 0; i < num_photos_; ++i) {
      LocalizationResult& result = ResultOf(i);
      result.num_observations = result.num_tracks;
      result.mean_reprojection_error_px /= std::max(result.num_tracks, 1);
    }
  }

 private:
  LocalizationResult& ResultOf(int image) { return photos_[epoch_.photos[image]].record.result; }

  static void Clear(LocalizationResult* result) {
    result->pairs.clear();
    result->points.clear();
    result->num_tracks = result->num_observations = 0;
    result->mean_reprojection_error_px = 0;
  }

  // Adds a pair for each image that a photo shares matches with, in the order of names.
  void AddPairs() {
    std::vector<std::map<std::string, std::pair<int, int>>> pairs(epoch_.photos.size());  // image and matches, by name
    for (const JointPair& pair : epoch_.scene.pairs) {
      const auto count = static_cast<int>(pair.matches.size());
      for (const auto& [image, other] : {std::pair(pair.image1, pair.image2), std::pair(pair.image2, pair.image1)}) {
        if (image < num_photos_) pairs[image].emplace(epoch_.names[other], std::pair(other, count));
      }
    }
    for (int i = 0; i < num_photos_; ++i) {
      for (const auto& name_and_other : pairs[i]) PairOf(i, name_and_other.second.first, name_and_other.second.second);
    }
  }

  // Returns the index of a photo's pair with another image, which is added if there is none: a chain of matches may
  // lead to an image without matches with the photo.
  int PairOf(int image, int other, int num_matches) {
    std::vector<PairResult>& pairs = ResultOf(image).pairs;
    const auto [entry, is_new] = pair_of_image_[image].emplace(other, static_cast<int>(pairs.size()));
    if (is_new) pairs.push_back({epoch_.names[other], num_matches, kUnknown, kUnknown});
    return entry->second;
  }

  // Adds a point to the first photo that observes it, and counts it for all.
  void AddPoint(const JointPoint& joint) {
    const JointObservation& first = joint.observations.front();
    if (first.image >= num_photos_) return;  // only database images see it
    PointResult point;
    point.point_in_world = joint.point_in_world + epoch_.origin;
    point.query_point = static_cast<int>(first.keypoint);
    double sum = 0;
    for (const JointObservation& observation : joint.observations) {
      const double error_px = ReprojectionErrorPx(epoch_.scene, joint, observation);
      sum += error_px;
      if (observation.image < num_photos_) {
        ++ResultOf(observation.image).num_tracks;
        ResultOf(observation.image).mean_reprojection_error_px += error_px;
      }
      if (observation.image == first.image) continue;
      point.observations.emplace_back(PairOf(first.image, observation.image, 0),
                                      static_cast<int>(observation.keypoint));
    }
    point.mean_reprojection_error_px = sum / static_cast<double>(joint.observations.size());
    ResultOf(first.image).points.push_back(std::move(point));
  }

  const EpochScene& epoch_;
  std::vector<EpochPhoto>& photos_;
  const int num_photos_;
  std::vector<std::map<int, int>> pair_of_image_;  // index of a photo's pair, by the other image
};

// Names the photos with poses that the last adjustment has left out.
void ReportLeftOut(const std::vector<EpochPhoto>& photos, bool is_surveyed,
                   const std::function<void(const std::string&)>& report) {
  std::string names;
  int count = 0;
  for (const EpochPhoto& photo : photos) {
    const bool is_localized = photo.record.result.status == QueryStatus::LOCALIZED;
    if (!is_localized || (photo.record.epoch && photo.record.epoch->is_adjusted)) continue;
    if (++count <= kMaxNumNames) names += (count > 1 ? ", " : "") + photo.Name();
  }
  if (count == 0) return;
  report(Format(
      "WARNING: %d of the photos could not be adjusted with the others (for example spherical, or too few matches) and "
      "keep their poses%s: %s%s",
      count, is_surveyed ? ", which do not follow the control points" : "", names.c_str(),
      count > kMaxNumNames ? ", ..." : ""));
}

// Counts the photos with poses by camera, and takes the first intrinsics of a camera from a photo that hangs.
void CountPhotos(const std::vector<EpochPhoto>& photos, std::vector<EpochCamera>* cameras) {
  std::vector<int> counts(cameras->size(), 0);
  for (const EpochPhoto& photo : photos) {
    if (!photo.is_placed) continue;
    EpochCamera& camera = (*cameras)[photo.camera];
    if (camera.num_photos == 0 && counts[photo.camera] == 0) camera.camera = photo.record.result.query_camera;
    ++counts[photo.camera];
  }
  for (size_t i = 0; i < counts.size(); ++i) (*cameras)[i].num_photos = counts[i];
}

// Reports that the control points are not used, because they contradict the poses and the photos.
void ReportMisfit(const ControlMarks& marks, double mark_stddev_px,
                  const std::function<void(const std::string&)>& report) {
  const std::string distance =
      std::isfinite(marks.median_distance)
          ? Format(" (by their marks, the points are %.*f from their coordinates, in the unit of the model)",
                   marks.median_distance < 10 ? 3 : 0, marks.median_distance)
          : "";
  report(Format(
      "WARNING: the control points do not fit the poses and the photos, and are not used: most marks are off by more "
      "than %.3g px%s. Check the coordinate system of the points and of the poses (CRS, order of the axes, unit), and "
      "that the marks are of the right points. If the coordinates are less accurate than stated, increase their "
      "standard deviation",
      kMaxMarkErrorSigma * mark_stddev_px, distance.c_str()));
}

// Reports which marks of control points were not used, and how far the others are off.
void ReportControlPoints(const std::vector<ControlPoint>& control, const EpochScene& epoch, const ControlMarks& marks,
                         const std::function<void(const std::string&)>& report) {
  for (const WrongMark& wrong : marks.wrong) {
    const std::string why = std::isfinite(wrong.error_px) ? Format("it is off by %.0f px", wrong.error_px)
                                                          : "the point is behind the image";
    report(Format("WARNING: the mark of control point '%s' in %s is left out, because %s",
                  control[wrong.control_point].name.c_str(), epoch.names[wrong.image].c_str(), why.c_str()));
  }
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  int num_points = 0, num_marks = 0;
  double squares_px = 0;
  for (const JointPoint& point : marks.points) {
    if (point.observations.empty()) continue;
    ++num_points;
    squares += (point.point_in_world - point.survey->place).cwiseAbs2();
    for (const JointObservation& mark : point.observations) {
      const double error_px = ReprojectionErrorPx(epoch.scene, point, mark);
      if (epoch.scene.images[mark.image].is_database) continue;  // has the pose that was given again
      ++num_marks;
      squares_px += error_px * error_px;
    }
  }
  const Eigen::Vector3d rms = (squares / num_points).cwiseSqrt();
  report(Format("%d control points: off by %.4f %.4f %.4f (root mean square), and by %.2f px at %d marks in new photos",
                num_points, rms.x(), rms.y(), rms.z(), std::sqrt(squares_px / std::max(num_marks, 1)), num_marks));
}

// Adjusts a scene again, with control points. Returns false, and changes nothing, if no control point can be used.
bool PlaceBySurvey(const std::vector<ControlPoint>& control, const EpochOptions& options,
                   const std::function<void(const std::string&)>& report, EpochSceneBuilder* builder, EpochScene* epoch,
                   std::vector<EpochCamera>* cameras, std::vector<EpochPhoto>* photos) {
  EpochScene surveyed = builder->Build(*photos, *cameras);
  builder->AddControlPoints(control, options.mark_stddev_px, &surveyed);
  std::vector<EpochCamera> new_cameras = *cameras;
  std::vector<EpochPhoto> new_photos = *photos;
  const AdjustedPhotos adjusted = Adjust(report, &surveyed, &new_cameras, &new_photos);
  if (!adjusted.control_fits) {
    const auto has_mark = [](const JointPoint& point) { return !point.observations.empty(); };
    const std::vector<JointPoint>& points = adjusted.control.points;
    if (adjusted.control.wrong.empty() && std::none_of(points.begin(), points.end(), has_mark)) {
      report("WARNING: no control point could be used: the survey does not place the new photos");
    } else {
      ReportMisfit(adjusted.control, options.mark_stddev_px, report);
    }
    return false;
  }
  ReportControlPoints(control, surveyed, adjusted.control, report);
  *epoch = std::move(surveyed);
  *cameras = std::move(new_cameras);
  *photos = std::move(new_photos);
  return true;
}

}  // namespace

bool EpochOptions::Check(std::string* error) const {
  if (num_threads < 1 && num_threads != -1) *error = "num_threads must be >= 1, or -1";
  if (!(min_confidence >= 0 && min_confidence <= 1)) *error = "min_confidence must be from 0 to 1";
  if (!(mark_stddev_px > 0 && std::isfinite(mark_stddev_px))) *error = "mark_stddev_px must be greater than 0";
  return error->empty();
}

std::vector<QueryRecord> AdjustEpoch(const Model& model, std::vector<LocalizationResult> localized,
                                     const std::vector<ControlPoint>& control, const DatabaseReader& database,
                                     const EpochOptions& options, const std::filesystem::path& scratch_file,
                                     const std::function<void(const std::string&)>& report) {
  std::vector<EpochPhoto> photos = MakePhotos(std::move(localized), database);
  std::vector<EpochCamera> cameras = ChooseCameras(model, database, options.shares_intrinsics, &photos);
  EpochSceneBuilder builder(model, database, photos);
  const HangingOptions hanging = {database.Path().string(), options.min_confidence, options.num_threads, scratch_file};
  EpochScene epoch;
  for (int i = 0;; ++i) {
    epoch = builder.Build(photos, cameras);
    Adjust(report, &epoch, &cameras, &photos);
    const int num_removed = RemoveUnconfirmed(&photos);
    if (num_removed > 0) {
      report(Format("%d photos do not fit those they hang on, or could not be adjusted with them", num_removed));
    }
    const int num_found = i < kMaxNumHangings ? HangPhotos(model, cameras, hanging, &photos) : 0;
    if (num_found > 0) report(Format("%d photos hang on others", num_found));
    if (num_found + num_removed == 0) break;
    CountPhotos(photos, &cameras);
  }
  const bool is_surveyed =
      !control.empty() && PlaceBySurvey(control, options, report, &builder, &epoch, &cameras, &photos);
  ReportLeftOut(photos, is_surveyed, report);
  PointsAdder(epoch, &photos).AddAll();
  std::vector<QueryRecord> records;
  for (EpochPhoto& photo : photos) records.push_back(std::move(photo.record));
  return records;
}

}  // namespace lazyloc
