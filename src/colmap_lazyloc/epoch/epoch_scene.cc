#include "colmap_lazyloc/epoch/epoch_scene.h"

#include <algorithm>
#include <set>

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

int EpochSceneBuilder::AddDatabaseImage(uint32_t id, EpochScene* epoch) {
  const auto [image, is_new] = epoch->image_of_id.emplace(id, static_cast<int>(epoch->scene.images.size()));
  if (!is_new) return image->second;
  return AddModelImage(*posed_of_id_.at(id), KeypointsOf(id), epoch);
}

int EpochSceneBuilder::AddModelImage(const ModelImage& posed, const std::vector<Eigen::Vector2d>& keypoints,
                                     EpochScene* epoch) const {
  const auto [camera, is_new_camera] =
      epoch->camera_of_model.emplace(posed.camera_id, static_cast<int>(epoch->scene.cameras.size()));
  if (is_new_camera) epoch->scene.cameras.push_back({model_.cameras.at(posed.camera_id), true});
  epoch->names.push_back(posed.name);
  epoch->scene.images.push_back({camera->second, RelativeTo(epoch->origin, posed.cam_from_world), true, 1, keypoints});
  return static_cast<int>(epoch->scene.images.size()) - 1;
}

EpochScene EpochSceneBuilder::Build(const std::vector<EpochPhoto>& photos, const std::vector<EpochCamera>& cameras) {
  EpochScene epoch;
  epoch.origin = MeanPosition(photos);
  for (const EpochCamera& camera : cameras) epoch.scene.cameras.push_back(camera);
  for (size_t i = 0; i < photos.size(); ++i) {
    const EpochPhoto& photo = photos[i];
    if (!photo.is_placed) continue;
    epoch.image_of_id.emplace(*photo.database_id, static_cast<int>(epoch.photos.size()));
    epoch.photos.push_back(static_cast<int>(i));
    epoch.names.push_back(photo.Name());
    epoch.scene.images.push_back(
        {photo.camera, RelativeTo(epoch.origin, photo.Pose()), false, 1, KeypointsOf(*photo.database_id)});
  }
  for (const int index : epoch.photos) {
    const uint32_t id = *photos[index].database_id;
    for (const uint32_t other : neighbours_[id]) {
      const bool is_database = posed_of_id_.count(other) > 0;
      if (!is_database && (epoch.image_of_id.count(other) == 0 || other < id))
        continue;  // a pair of photos counts once
      const Matches& matches = MatchesOf({id, other});
      if (matches.empty()) continue;
      const int image = is_database ? AddDatabaseImage(other, &epoch) : epoch.image_of_id.at(other);
      epoch.scene.pairs.push_back({image, epoch.image_of_id.at(id), matches});
    }
  }
  return epoch;
}

void EpochSceneBuilder::AddControlPoints(const std::vector<ControlPoint>& control, double mark_stddev_px,
                                         EpochScene* epoch) {
  std::map<std::string, int> image_of_name;
  for (size_t i = 0; i < epoch->names.size(); ++i) image_of_name.emplace(epoch->names[i], static_cast<int>(i));
  std::set<std::string> marked;
  for (const ControlPoint& point : control) {
    for (const ControlMark& mark : point.marks) marked.insert(mark.image_name);
  }
  for (const ModelImage& posed : model_.images) {
    if (marked.count(posed.name) == 0 || image_of_name.count(posed.name) > 0) continue;
    if (IsEquirectangular(model_.cameras.at(posed.camera_id))) continue;
    image_of_name.emplace(posed.name, AddModelImage(posed, {}, epoch));  // that no match connects with the photos
  }
  for (const ControlPoint& point : control) {
    JointPoint joint;
    joint.survey = Survey{point.place - epoch->origin, point.stddevs, mark_stddev_px};
    for (const ControlMark& mark : point.marks) {
      const auto image = image_of_name.find(mark.image_name);
      if (image == image_of_name.end()) continue;  // a photo without a pose
      std::vector<Eigen::Vector2d>& keypoints = epoch->scene.images[image->second].keypoints;
      joint.observations.push_back({image->second, static_cast<uint32_t>(keypoints.size())});
      keypoints.push_back(mark.pixel);
    }
    std::sort(joint.observations.begin(), joint.observations.end(),
              [](const JointObservation& a, const JointObservation& b) { return a.image < b.image; });
    epoch->scene.control_points.push_back(std::move(joint));
  }
}

}  // namespace lazyloc
