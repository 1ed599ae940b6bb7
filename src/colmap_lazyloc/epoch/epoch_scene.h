#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/epoch/epoch_photo.h"
#include "colmap_lazyloc/scene/control_point.h"
#include "colmap_lazyloc/scene/joint_scene.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// A joint scene of the photos that have a pose, and of the database images that they share verified matches with.
struct EpochScene {
  JointScene scene;                                  // the photos come before the database images
  std::vector<std::string> names;                    // by image of the scene
  std::vector<int> photos;                           // index of the photo, by image of the scene; only of photos
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // of the scene, in the world
  std::map<uint32_t, int> image_of_id;               // index of an image, by its id in the database
  std::map<uint32_t, int> camera_of_model;           // index of a camera of database images, by its id in the model
};

// Makes scenes of the photos of a database. Reads keypoints and matches once.
class EpochSceneBuilder {
 public:
  EpochSceneBuilder(const Model& model, const DatabaseReader& database, const std::vector<EpochPhoto>& photos);

  EpochScene Build(const std::vector<EpochPhoto>& photos, const std::vector<EpochCamera>& cameras);
  // Adds control points to a scene, and the database images that only marks connect with it.
  void AddControlPoints(const std::vector<ControlPoint>& control, double mark_stddev_px, EpochScene* epoch);

 private:
  using Ids = std::pair<uint32_t, uint32_t>;  // of two images in the database

  // Returns the verified matches, from the second image to the first one; none if they cannot be used.
  const Matches& MatchesOf(const Ids& ids);
  const std::vector<Eigen::Vector2d>& KeypointsOf(uint32_t image_id);
  // Adds a database image unless the scene has it. Returns its index.
  int AddDatabaseImage(uint32_t id, EpochScene* epoch);
  int AddModelImage(const ModelImage& posed, const std::vector<Eigen::Vector2d>& keypoints, EpochScene* epoch) const;

  const Model& model_;
  const DatabaseReader& database_;
  std::vector<uint32_t> ids_;                          // of the model's images and the photos in the database, sorted
  std::map<uint32_t, const ModelImage*> posed_of_id_;  // by id in the database
  std::map<uint32_t, std::vector<uint32_t>> neighbours_;  // of photos
  std::map<Ids, Matches> matches_;
  std::map<uint32_t, std::vector<Eigen::Vector2d>> keypoints_;
};

// Returns a pose in a world whose origin is at the given place.
Rigid3d RelativeTo(const Eigen::Vector3d& origin, const Rigid3d& cam_from_world);

}  // namespace lazyloc
