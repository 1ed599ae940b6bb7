#include "colmap_lazyloc/epoch/epoch_scene.h"

#include <algorithm>

#include "colmap_lazyloc/scene/equirectangular.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {
namespace {

Eigen::Vector3d MeanPosition(const std::vector<EpochPhoto>& photos) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  int count = 0;
  for (const EpochPhoto& photo : photos) {
    if (!photo.is_placed) continue;
    sum += CamInWorld(photo.Pose());
    ++count;
  }
  return count == 0 ? sum : Eigen::Vector3d(sum / count);
}

}  // namespace

Rigid3d RelativeTo(const Eigen::Vector3d& origin, const Rigid3d& cam_from_world) {
  const Eigen::Quaterniond rotation = cam_from_world.rotation.normalized();
  return {rotation, rotation * origin + cam_from_world.translation};
}

EpochSceneBuilder::EpochSceneBuilder(const Model& model, const DatabaseReader& database,
                                     const std::vector<EpochPhoto>& photos)
    : model_(model), database_(database) {
  for (const DatabaseImage& image : database.ReadImages()) {
    const ModelImage* posed = FindByName(model.images, image.name);
    if (posed == nullptr || IsEquirectangular(model.cameras.at(posed->camera_id))) continue;
    posed_of_id_.emplace(image.image_id, posed);
    ids_.push_back(image.image_id);
  }
  for (const EpochPhoto& photo : photos) {
    if (photo.database_id) ids_.push_back(*photo.database_id);
  }
  std::sort(ids_.begin(), ids_.end());
  for (const EpochPhoto& photo : photos) {
    if (!photo.database_id) continue;
    for (const PairSize& pair : database.ReadInlierCounts(*photo.database_id, ids_)) {
      if (pair.num_matches >= kMinNumInliers) neighbours_[*photo.database_id].push_back(pair.image_id);
    }
  }
}

const std::vector<Eigen::Vector2d>& EpochSceneBuilder::KeypointsOf(uint32_t image_id) {
  const auto [entry, is_new] = keypoints_.emplace(image_id, std::vector<Eigen::Vector2d>());
  if (is_new) entry->second = database_.ReadKeypointsOnce(image_id);
  return entry->second;
}

const Matches& EpochSceneBuilder::MatchesOf(const Ids& ids) {
  const auto [entry, is_new] = matches_.emplace(ids, Matches());
  if (!is_new) return entry->second;
  try {
    const auto geometry = database_.ReadTwoViewGeometry(ids.first, ids.second);
    if (!geometry || geometry->config == TwoViewConfig::WATERMARK || geometry->config == TwoViewConfig::DEGENERATE) {
      return entry->second;
    }
    const size_t num_query = KeypointsOf(ids.first).size(), num_other = KeypointsOf(ids.second).size();
    for (const Match& match : geometry->inlier_matches) {
      if (match.query_point < num_query && match.other_point < num_other) entry->second.push_back(match);
    }
  } catch (const DamagedRecordError&) {
    entry->second.clear();  // other pairs do without this one
  }
  return entry->second;
}

EpochScene EpochSceneBuilder::Build(const std::vector<EpochPhoto>& photos, const std::vector<EpochCamera>& cameras) {
  EpochScene epoch;
  epoch.origin = MeanPosition(photos);
  for (const EpochCamera& camera : cameras) epoch.scene.cameras.push_back({camera.camera, camera.is_constant});
  std::map<uint32_t, int> image_of_id, camera_of_model;
  const auto add = [&](uint32_t id, const std::string& name, int camera, const Rigid3d& pose, bool is_database) {
    image_of_id.emplace(id, static_cast<int>(epoch.scene.images.size()));
    epoch.names.push_back(name);
    epoch.scene.images.push_back({camera, RelativeTo(epoch.origin, pose), is_database, 1, KeypointsOf(id)});
  };
  for (size_t i = 0; i < photos.size(); ++i) {
    if (!photos[i].is_placed) continue;
    epoch.photos.push_back(static_cast<int>(i));
    add(*photos[i].database_id, photos[i].Name(), photos[i].camera, photos[i].Pose(), false);
  }
  for (const int index : epoch.photos) {
    const uint32_t id = *photos[index].database_id;
    for (const uint32_t other : neighbours_[id]) {
      const auto posed = posed_of_id_.find(other);
      const bool is_database = posed != posed_of_id_.end();
      if (!is_database && (image_of_id.count(other) == 0 || other < id)) continue;  // a pair of photos counts once
      const Matches& matches = MatchesOf({id, other});
      if (matches.empty()) continue;
      if (image_of_id.count(other) == 0) {
        const uint32_t camera_id = posed->second->camera_id;
        const auto [camera, is_new] = camera_of_model.emplace(camera_id, static_cast<int>(epoch.scene.cameras.size()));
        if (is_new) epoch.scene.cameras.push_back({model_.cameras.at(camera_id), true});
        add(other, posed->second->name, camera->second, posed->second->cam_from_world, true);
      }
      epoch.scene.pairs.push_back({image_of_id.at(other), image_of_id.at(id), matches});
    }
  }
  return epoch;
}

}  // namespace lazyloc
