#include "colmap_lazyloc/queries/query_selection.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Maximum number of image files that are read for a query of a new size, because each takes as long as a photo.
constexpr size_t kMaxNumFiles = 20;

template <typename T>
void SortUnique(std::vector<T>* values) {
  std::sort(values->begin(), values->end());
  values->erase(std::unique(values->begin(), values->end()), values->end());
}

// Throws DamagedRecordError if a camera of the database cannot be used.
void CheckUsable(const Camera& camera, const DatabaseReader& database) {
  const std::string problem = CameraProblem(camera);
  if (problem.empty()) return;
  throw DamagedRecordError(database.Path().string(),
                           "table cameras, camera " + std::to_string(camera.camera_id) + ": " + problem);
}

}  // namespace

QuerySelection::QuerySelection(const DatabaseReader& database, Model model, const QuerySelectionOptions& options,
                               const std::string& image_path)
    : options_(options),
      image_path_(image_path),
      has_photos_(!image_path.empty() && !options.leave_one_out),
      model_(std::move(model)),
      camera_properties_(
          [](const PhotoProperties& properties) { return sizeof(PhotoProperties) + properties.exif_camera.size(); }) {
  ReadImages(database);
  const std::vector<std::string_view> query_names = AddQueries(database);
  num_queries_ = query_names.size();
  if (!query_names.empty()) GroupAll(query_names, database);
  if (!options_.leave_one_out) {
    const auto is_query = [this](const ModelImage& image) {
      return FindStoredQuery(image.name) || photos_.count(image.name) > 0;
    };
    model_.images.erase(std::remove_if(model_.images.begin(), model_.images.end(), is_query), model_.images.end());
  }
  for (const ModelImage& image : model_.images) {
    const DatabaseImage* stored = FindInDatabase(image.name);
    if (stored == nullptr) continue;
    posed_ids_.push_back(stored->image_id);
    posed_of_database_id_.emplace(stored->image_id, &image);
  }
  std::sort(posed_ids_.begin(), posed_ids_.end());
  database_cameras_.emplace(model_, ReadExifFocalLengths(database));
  frame_of_database_image_ = DatabaseFramePlaces(model_, &database, options_.groups);
  if (!options_.pairs_path.empty()) ReadPairsFile();
}

void QuerySelection::ReadImages(const DatabaseReader& database) {
  std::vector<DamagedImage> damaged;
  database_images_ = database.ReadImages(&damaged);
  roles_.resize(database_images_.size());
  for (const DamagedImage& image : damaged) {
    warnings_.push_back(database.Path().string() + ": " + image.damage + ": leaving the image out");
    if (image.name.empty()) {
      damage_of_unknown_image_ = image.damage;
    } else {
      damage_of_image_.emplace(image.name, image.damage);
    }
  }
}

std::map<uint32_t, double> QuerySelection::ReadExifFocalLengths(const DatabaseReader& database) const {
  std::map<uint32_t, double> focal_lengths_px;
  std::set<uint32_t> camera_ids;
  for (const ModelImage& image : model_.images) {
    const DatabaseImage* stored = FindInDatabase(image.name);
    if (stored == nullptr || !camera_ids.insert(image.camera_id).second) continue;
    try {
      const Camera camera = database.ReadCamera(stored->camera_id);
      if (!CameraProblem(camera).empty()) continue;
      if (const auto focal_length_px = FocalLengthOfExifPx(camera))
        focal_lengths_px[image.camera_id] = *focal_length_px;
    } catch (const DamagedRecordError&) {
      // Leaves a damaged camera out, because the model's is used.
    }
  }
  return focal_lengths_px;
}

std::vector<DatabaseCamera> QuerySelection::CamerasLike(const PhotoProperties& query) const {
  std::vector<DatabaseCamera> cameras = database_cameras_->OfSize(query.width, query.height);
  if (image_path_.empty() || (query.exif_camera.empty() && !query.exif_focal_length_px)) return cameras;
  for (size_t i = 0; i < std::min(cameras.size(), kMaxNumFiles); ++i) {
    const uint32_t camera_id = cameras[i].camera.camera_id;
    const auto file = camera_properties_.Get(camera_id, [&] { return ReadPropertiesOfCamera(camera_id); });
    cameras[i].exif_camera = file->exif_camera;
    // The database does not have the focal length of EXIF if the user has given the intrinsics.
    if (!cameras[i].exif_focal_length_px) cameras[i].exif_focal_length_px = file->exif_focal_length_px;
  }
  return cameras;
}

PhotoProperties QuerySelection::ReadPropertiesOfCamera(uint32_t camera_id) const {
  for (const ModelImage& image : model_.images) {
    if (image.camera_id != camera_id) continue;
    const std::filesystem::path path = std::filesystem::path(image_path_) / image.name;
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) continue;
    const std::optional<PhotoFile> file = PhotoFile::Read(path);
    return file ? file->Properties() : PhotoProperties();
  }
  return {};
}

std::string QuerySelection::DamageOf(const std::string& name) const {
  const auto damage = damage_of_image_.find(name);
  // An image that is not found may be the one whose name cannot be read.
  return damage == damage_of_image_.end() ? damage_of_unknown_image_ : damage->second;
}

std::vector<std::string_view> QuerySelection::AddQueries(const DatabaseReader& database) {
  std::unordered_map<std::string, const ModelImage*> posed_images;
  for (const ModelImage& image : model_.images) posed_images.emplace(image.name, &image);
  std::vector<std::string_view> names;
  const auto add = [&](QueryListEntry entry) {
    const auto posed = posed_images.find(entry.name);
    const ModelImage* image = posed == posed_images.end() ? nullptr : posed->second;
    const std::string_view name = IsPhoto(entry.name, database) ? AddPhoto(entry, image, database)
                                                                : AddStoredQuery(std::move(entry), image, database);
    if (!name.empty()) names.push_back(name);
    return !name.empty();
  };
  if (!options_.query_list_path.empty()) {
    ReadQueryList(options_.query_list_path, add);  // keeps its order, because groups may be runs of the list
  } else {
    std::vector<std::string> candidates;
    for (const DatabaseImage& image : database_images_) candidates.push_back(image.name);
    for (const auto& [name, damage] : damage_of_image_) candidates.push_back(name);
    std::sort(candidates.begin(), candidates.end());
    for (const std::string& name : candidates) {
      if ((posed_images.count(name) > 0) == options_.leave_one_out) add({name, std::nullopt});
    }
  }
  if (names.empty() && !options_.has_more_queries) {
    throw InputError(database.Path().string() + ": " +
                     (options_.leave_one_out ? "no posed image of --input_path is in the database"
                                             : "every image has a pose in --input_path: nothing to localize (see "
                                               "--query_list_path, --LazyLocalizer.leave_one_out)"));
  }
  return names;
}

bool QuerySelection::IsPhoto(const std::string& name, const DatabaseReader& database) const {
  if (!has_photos_) return false;
  const DatabaseImage* image = FindInDatabase(name);
  if (image == nullptr) return damage_of_image_.count(name) == 0;
  try {
    return database.ReadKeypointsOnce(image->image_id).empty();
  } catch (const DamagedRecordError&) {
    return false;  // because the image has keypoints
  }
}

std::string_view QuerySelection::AddPhoto(const QueryListEntry& entry, const ModelImage* posed,
                                          const DatabaseReader& database) {
  PhotoQuery photo;
  photo.name = entry.name;
  const DatabaseImage* image = FindInDatabase(entry.name);
  if (entry.camera) {
    photo.camera = entry.camera;
  } else if (posed != nullptr) {
    photo.camera = model_.cameras.at(posed->camera_id);
    photo.source = IntrinsicsSource::MODEL;
  } else if (image != nullptr) {
    photo.source = IntrinsicsSource::DATABASE;
    try {
      const Camera camera = database.ReadCamera(image->camera_id);
      CheckUsable(camera, database);
      photo.camera = camera;
    } catch (const DamagedRecordError& error) {
      photo.damage = error.Damage();
    }
  }
  const auto [added, is_new] = photos_.emplace(entry.name, std::move(photo));
  return is_new ? added->first : std::string_view();
}

std::string_view QuerySelection::AddStoredQuery(QueryListEntry entry, const ModelImage* posed,
                                                const DatabaseReader& database) {
  const DatabaseImage* image = FindInDatabase(entry.name);
  if (image == nullptr && DamageOf(entry.name).empty()) {
    throw InputError("--query_list_path: query " + entry.name + " is not in the database " + database.Path().string());
  }
  if (options_.leave_one_out && posed == nullptr) {
    throw InputError("--query_list_path: query " + entry.name +
                     " has no pose in --input_path, but --LazyLocalizer.leave_one_out needs one");
  }
  if (image == nullptr) {
    const auto [added, is_new] = group_of_damaged_query_.emplace(entry.name, 0);
    return is_new ? added->first : std::string_view();
  }
  ImageRole& role = RoleOf(*image);
  if (std::exchange(role.is_query, true)) return {};
  if (entry.camera) {
    // Keeps one camera for a run of queries, because lists often repeat it.
    if (listed_cameras_.empty() || !SameIntrinsics(listed_cameras_.back(), *entry.camera)) {
      listed_cameras_.push_back(*std::move(entry.camera));
    }
    role.source = IntrinsicsSource::QUERY_LIST;
    role.camera = static_cast<uint32_t>(listed_cameras_.size() - 1);
  } else if (posed != nullptr) {
    role.source = IntrinsicsSource::MODEL;
    role.camera = posed->camera_id;
  }
  return image->name;
}

StoredQuery QuerySelection::ReadStoredQuery(const std::string& name, const DatabaseReader& database) const {
  const DatabaseImage* image = FindInDatabase(name);
  if (image == nullptr) throw DamagedRecordError(database.Path().string(), DamageOf(name));
  const ImageRole& role = RoleOf(*image);
  StoredQuery query;
  query.image = *image;
  query.source = role.source;
  query.stored_camera = database.ReadCamera(image->camera_id);
  if (role.source == IntrinsicsSource::QUERY_LIST) {
    query.camera = listed_cameras_[role.camera];
  } else if (role.source == IntrinsicsSource::MODEL) {
    query.camera = model_.cameras.at(role.camera);
    query.camera.has_prior_focal_length = query.stored_camera.has_prior_focal_length;  // models do not store it
    query.intrinsics_origin = IntrinsicsOrigin::MODEL;
  } else {
    CheckUsable(query.stored_camera, database);
    // Leaves the cameras of a rig, because they may have the same size and different lenses.
    std::vector<DatabaseCamera> cameras;
    if (groups_.IsSingle(role.group)) {
      cameras = CamerasLike(PropertiesOfStored(query.stored_camera));
    }
    const PhotoCamera chosen = ChooseStoredCamera(query.stored_camera, cameras);
    query.camera = chosen.camera;
    query.source = chosen.source;
    query.intrinsics_origin = chosen.Origin();
  }
  return query;
}

void QuerySelection::GroupAll(const std::vector<std::string_view>& query_names, const DatabaseReader& database) {
  groups_ = GroupQueries(query_names, database, model_, options_.groups);
  warnings_.insert(warnings_.end(), groups_.warnings.begin(), groups_.warnings.end());
  for (size_t group = 0; group < groups_.Size(); ++group) {
    for (const QueryFrame& frame : groups_.At(group)) {
      for (const QueryFrame::Image& query : frame.images) {
        const std::string name(query.name);
        const auto photo = photos_.find(name);
        if (photo != photos_.end()) {
          photo->second.group = group;
        } else if (const DatabaseImage* image = FindInDatabase(name)) {
          RoleOf(*image).group = static_cast<uint32_t>(group);
        } else {
          group_of_damaged_query_.at(name) = group;
        }
      }
    }
  }
}

void QuerySelection::ReadPairsFile() {
  std::set<std::string> unknown_names;
  bool has_known_names = false;
  for (auto& [name, photo] : photos_) photo.paired_ids.emplace();
  ReadPairs(options_.pairs_path, [&](const std::string& name1, const std::string& name2) {
    for (const std::string& name : {name1, name2}) {
      const bool is_known = FindInDatabase(name) != nullptr || photos_.count(name) > 0;
      has_known_names = has_known_names || is_known;
      if (!is_known) unknown_names.insert(name);
    }
    if (name1 == name2) return;  // retrieval tools list an image as its own neighbour
    AddListedPair(name1, name2);
    AddListedPair(name2, name1);
  });
  if (!has_known_names) {
    throw InputError(options_.pairs_path + ": none of its images is in the database (for example " +
                     *unknown_names.begin() + ")");
  }
  SortUnique(&listed_pairs_);
  for (auto& [name, photo] : photos_) SortUnique(&*photo.paired_ids);
  if (!unknown_names.empty()) {
    warnings_.push_back(options_.pairs_path + ": ignoring images that are not in the database: " +
                        std::to_string(unknown_names.size()) + ", for example " + *unknown_names.begin());
  }
}

void QuerySelection::AddListedPair(const std::string& query_name, const std::string& other_name) {
  const DatabaseImage* other = FindInDatabase(other_name);
  if (other == nullptr) return;
  const auto photo = photos_.find(query_name);
  if (photo != photos_.end()) {
    photo->second.paired_ids->push_back(other->image_id);
  } else if (const std::optional<uint32_t> query_id = FindStoredQuery(query_name)) {
    listed_pairs_.emplace_back(*query_id, other->image_id);
  }
}

std::optional<size_t> QuerySelection::FindGroup(const std::string& query_name) const {
  const auto photo = photos_.find(query_name);
  if (photo != photos_.end()) return photo->second.group;
  const DatabaseImage* image = FindInDatabase(query_name);
  if (image != nullptr)
    return RoleOf(*image).is_query ? std::make_optional<size_t>(RoleOf(*image).group) : std::nullopt;
  const auto damaged = group_of_damaged_query_.find(query_name);
  return damaged == group_of_damaged_query_.end() ? std::nullopt : std::make_optional(damaged->second);
}

std::optional<uint32_t> QuerySelection::FindStoredQuery(const std::string& name) const {
  const DatabaseImage* image = FindInDatabase(name);
  return image != nullptr && RoleOf(*image).is_query ? std::make_optional(image->image_id) : std::nullopt;
}

const ModelImage* QuerySelection::FindPosedImage(uint32_t image_id, const std::string& query_name) const {
  const auto posed = posed_of_database_id_.find(image_id);
  if (posed == posed_of_database_id_.end()) return nullptr;
  const std::optional<size_t> group = FindGroup(posed->second->name);
  return group && group == FindGroup(query_name) ? nullptr : posed->second;
}

std::optional<std::vector<uint32_t>> QuerySelection::ListedPairs(const StoredQuery& query) const {
  if (options_.pairs_path.empty()) return std::nullopt;
  const uint32_t query_id = query.image.image_id;
  std::vector<uint32_t> ids;
  for (auto pair = std::lower_bound(listed_pairs_.begin(), listed_pairs_.end(), std::make_pair(query_id, 0u));
       pair != listed_pairs_.end() && pair->first == query_id; ++pair) {
    ids.push_back(pair->second);
  }
  return ids;
}

ImagePair MakeDatabasePair(const ModelImage& database_image, const Model& model, const FramePlaces& frames) {
  ImagePair pair;
  pair.other_name = database_image.name;
  pair.other_camera = model.cameras.at(database_image.camera_id);
  pair.database_cam_from_world = database_image.cam_from_world;
  const auto frame = frames.find(database_image.name);
  if (frame == frames.end()) return pair;
  pair.database_frame_name = frame->second.frame_name;
  pair.database_cam_from_rig = frame->second.cam_from_rig;
  return pair;
}

}  // namespace lazyloc
