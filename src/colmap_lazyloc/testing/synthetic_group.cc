#include "colmap_lazyloc/testing/synthetic_group.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Returns a pose on the ring that looks at the points. part: position along the ring, in [0, 1].
Rigid3d RingPose(double part, double radius, Random* random) {
  const double angle = 2 * M_PI / 3 * part;
  const Eigen::Vector3d centre(radius * std::sin(angle), 0, -radius * std::cos(angle));
  const Eigen::Vector3d cam_in_world = centre + 0.3 * RandomVector(random);
  return LookAt(cam_in_world, 0.3 * RandomVector(random));
}

class GroupMaker {
 public:
  explicit GroupMaker(const SyntheticGroupOptions& options) : options_(options), random_(options.seed) {
    camera_ = CameraFromFocalLength(*CameraModelId("SIMPLE_PINHOLE"), /*focal_length_px=*/800, 1280, 960);
    camera_.has_prior_focal_length = false;
    std::uniform_real_distribution<double> uniform(-2.5, 2.5);
    for (int i = 0; i < options.num_points; ++i) {
      const double x = uniform(random_), y = uniform(random_), z = uniform(random_);
      points_.emplace_back(x, y, z);
    }
  }

  SyntheticGroup Make() {
    if (options_.has_database_rigs) return MakeWithDatabaseRigs();
    for (int i = 0; i < options_.num_database_images; ++i) {
      ImagePair image;
      image.other_name = "database" + std::to_string(100 + i);
      image.other_camera = camera_;
      image.database_cam_from_world = RingPose((i + 0.5) / options_.num_database_images, 10, &random_);
      image.other_keypoints = Project(image.database_cam_from_world);
      database_.push_back(image);
    }
    MakeSensors();
    return Finish();
  }

 private:
  SyntheticGroup MakeWithDatabaseRigs() {
    MakeSensors();
    true_last_rotation_ = Disturbed(cams_from_rig_.back().rotation, options_.calibration_error_deg, &random_);
    const int num_frames = options_.num_database_images / options_.num_sensors;
    for (int frame = 0; frame < num_frames; ++frame) {
      const Rigid3d rig_from_world = RingPose((frame + 0.5) / num_frames, 10, &random_);
      for (int sensor = 0; sensor < options_.num_sensors; ++sensor) {
        ImagePair image;
        image.other_name = "database" + std::to_string(100 + options_.num_sensors * frame + sensor);
        image.other_camera = camera_;
        image.database_frame_name = "frame" + std::to_string(frame);
        image.database_cam_from_rig = cams_from_rig_[sensor];
        image.database_cam_from_world = cams_from_rig_[sensor] * rig_from_world;
        true_database_poses_.push_back(TrueCamFromRig(sensor) * rig_from_world);
        image.other_keypoints = Project(true_database_poses_.back());
        database_.push_back(image);
      }
    }
    return Finish();
  }

  void MakeSensors() {
    for (int i = 1; i < options_.num_sensors; ++i) {
      cams_from_rig_.push_back({Disturbed(Eigen::Quaterniond::Identity(), 5, &random_), 0.4 * RandomVector(&random_)});
      if (options_.has_common_centre) cams_from_rig_.back().translation.setZero();
    }
  }

  // Returns the sensor's true place, of which the stated one may differ. Without rigs in the database, each frame has
  // an error of its own.
  Rigid3d TrueCamFromRig(int sensor) {
    Rigid3d cam_from_rig = cams_from_rig_[sensor];
    if (sensor + 1 < options_.num_sensors) return cam_from_rig;
    cam_from_rig.rotation = true_last_rotation_
                                ? *true_last_rotation_
                                : Disturbed(cam_from_rig.rotation, options_.calibration_error_deg, &random_);
    return cam_from_rig;
  }

  SyntheticGroup Finish() {
    for (int frame = 0; frame < options_.num_frames; ++frame) AddFrame(frame);
    if (options_.has_query_pairs) AddQueryPairs();
    scene_.points_in_world = points_;
    return scene_;
  }

  std::vector<Eigen::Vector2d> Project(const Rigid3d& cam_from_world) {
    std::vector<Eigen::Vector2d> keypoints;
    for (const Eigen::Vector3d& point : points_) {
      const std::optional<Eigen::Vector2d> xy = ImageFromCam(camera_, cam_from_world * point);
      LAZYLOC_CHECK(xy.has_value());
      keypoints.push_back(*xy + options_.pixel_noise_px * RandomVector(&random_).head<2>());
    }
    return keypoints;
  }

  TwoViewGeometry Geometry(const Rigid3d& query_from_other, bool is_outlier) {
    TwoViewGeometry geometry;
    geometry.config = TwoViewConfig::CALIBRATED;
    geometry.query_from_other =
        is_outlier ? Rigid3d{RandomRotation(&random_), RandomVector(&random_)} : query_from_other;
    geometry.query_from_other->translation.normalize();
    std::vector<uint32_t> other_points(points_.size());
    std::iota(other_points.begin(), other_points.end(), 0u);
    const double ratio = is_outlier ? 1 : options_.outlier_match_ratio;
    std::shuffle(other_points.begin(), other_points.begin() + static_cast<std::ptrdiff_t>(ratio * other_points.size()),
                 random_);
    for (uint32_t i = 0; i < other_points.size(); ++i) geometry.inlier_matches.push_back({i, other_points[i]});
    return geometry;
  }

  void AddFrame(int frame) {
    const Rigid3d rig_from_world = RingPose((frame + 0.4) / options_.num_frames, 8, &random_);
    scene_.group.frame_names.push_back(options_.num_sensors > 1 ? "frame" + std::to_string(frame) : "");
    for (int sensor = 0; sensor < options_.num_sensors; ++sensor) {
      QueryImage image;
      image.frame = frame;
      image.cam_from_rig = cams_from_rig_[sensor];
      const Rigid3d cam_from_world = TrueCamFromRig(sensor) * rig_from_world;
      image.problem.query_name = "query" + std::to_string(frame) + "-" + std::to_string(sensor);
      image.problem.query_camera = camera_;
      image.problem.query_keypoints = Project(cam_from_world);
      if (sensor < options_.num_sensors - options_.num_sensors_without_pairs) {
        for (size_t i = 0; i < database_.size(); ++i) {
          ImagePair pair = database_[i];
          const Rigid3d& database =
              true_database_poses_.empty() ? pair.database_cam_from_world : true_database_poses_[i];
          pair.geometry = Geometry(cam_from_world * Inverse(database),
                                   i < std::floor(options_.outlier_pair_ratio * database_.size()));
          image.problem.pairs.push_back(pair);
        }
      }
      scene_.group.images.push_back(image);
      scene_.cam_from_world.push_back(cam_from_world);
    }
  }

  void AddQueryPairs() {
    const std::vector<QueryImage>& queries = scene_.group.images;
    for (int query = 0; query < static_cast<int>(queries.size()); ++query) {
      for (int other = 0; other < query; ++other) {
        ImagePair images;
        images.other_name = queries[other].problem.query_name;
        images.other_camera = camera_;
        images.other_keypoints = queries[other].problem.query_keypoints;
        images.geometry = Geometry(scene_.cam_from_world[query] * Inverse(scene_.cam_from_world[other]), false);
        scene_.group.query_pairs.push_back({query, other, images});
      }
    }
  }

  const SyntheticGroupOptions& options_;
  Random random_;
  Camera camera_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Rigid3d> cams_from_rig_ = {{}};             // as stated, by sensor
  std::optional<Eigen::Quaterniond> true_last_rotation_;  // of the last sensor, if it is the same in all frames
  std::vector<ImagePair> database_;
  std::vector<Rigid3d> true_database_poses_;  // empty if the stated poses are true
  SyntheticGroup scene_;
};

}  // namespace

SyntheticGroup MakeSyntheticGroup(const SyntheticGroupOptions& options) { return GroupMaker(options).Make(); }

}  // namespace lazyloc
