#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Indices of a track's observations, ascending.
using ObservationIndices = std::vector<size_t>;

// Checks points of tracks against their images. Holds the poses as matrices, because the inner loops are faster with
// them.
class TrackEvaluator {
 public:
  explicit TrackEvaluator(const PosedImages& posed) : posed_(posed), poses_(CamsFromWorld(posed)) {
    for (const Rigid3d& cam_from_world : poses_) {
      cams_from_world_.emplace_back();
      cams_from_world_.back() << cam_from_world.rotation.toRotationMatrix(), cam_from_world.translation;
      cams_in_world_.push_back(CamInWorld(cam_from_world));
    }
  }

  bool IsDatabase(const TrackObservation& element) const { return posed_.IsDatabase(element.image); }
  const Image& ImageOf(const TrackObservation& element) const { return posed_.images[element.image]; }
  const Rigid3d& CamFromWorldOf(const TrackObservation& element) const { return poses_[element.image]; }
  const Eigen::Vector3d& CamInWorldOf(const TrackObservation& element) const { return cams_in_world_[element.image]; }
  Eigen::Vector3d RayInWorld(const TrackObservation& element) const {
    return cams_from_world_[element.image].leftCols<3>().transpose().lazyProduct(element.observation.ray_in_cam);
  }

  // Returns true if a point lies in front of an image and within max_error_sigma standard deviations of its keypoint.
  bool Fits(const TrackObservation& element, const Eigen::Vector3d& point_in_world, double max_error_sigma) const {
    return IsNear(element, point_in_world, max_error_sigma * ImageOf(element).noise_px);
  }

  // Does the same with a bound in pixels.
  bool IsNear(const TrackObservation& element, const Eigen::Vector3d& point_in_world, double max_error_px) const {
    const Eigen::Matrix<double, 3, 4>& cam_from_world = cams_from_world_[element.image];
    const Eigen::Vector3d point_in_cam = cam_from_world.leftCols<3>() * point_in_world + cam_from_world.col(3);
    return IsInFront(element.observation, point_in_cam) &&
           ReprojectionError(element.observation, point_in_cam).squaredNorm() <= max_error_px * max_error_px;
  }

  // Returns true if two of the rays to a point meet at an angle whose cosine is less than max_cos_angle.
  bool IsSeenUnderAngle(const std::vector<TrackObservation>& observations, const ObservationIndices& indices,
                        const Eigen::Vector3d& point, double max_cos_angle) const {
    for (size_t a = 0; a < indices.size(); ++a) {
      const Eigen::Vector3d ray_a = (point - CamInWorldOf(observations[indices[a]])).normalized();
      for (size_t b = 0; b < a; ++b) {
        const Eigen::Vector3d ray_b = (point - CamInWorldOf(observations[indices[b]])).normalized();
        if (ray_a.dot(ray_b) < max_cos_angle) return true;
      }
    }
    return false;
  }

 private:
  const PosedImages& posed_;
  std::vector<Rigid3d> poses_;
  std::vector<Eigen::Matrix<double, 3, 4>> cams_from_world_;
  std::vector<Eigen::Vector3d> cams_in_world_;
};

}  // namespace lazyloc
