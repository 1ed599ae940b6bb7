#include "colmap_lazyloc/io/query_selection.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Throws DamagedRecordError if the camera cannot be used.
Camera ReadUsableCamera(const DatabaseReader& database, const DatabaseImage& image) {
  Camera camera = database.ReadCamera(image.camera_id);
  const std::string problem = CameraProblem(camera);
  if (!problem.empty()) {
    throw DamagedRecordError(database.Path().string(),
                             "table cameras, camera " + std::to_string(image.camera_id) + ": " + problem);
  }
  return camera;
}

}  // namespace

QuerySelection::QuerySelection(const DatabaseReader& database, Model model, const QuerySelectionOptions& options,
                               bool has_photos)
    : options_(options), has_photos_(has_photos && !options.leave_one_out), model_(std::move(model)) {
  ReadImages(database);
  const std::vector<std::string> query_names = AddQueries(database);
  if (!query_names.empty()) GroupAll(query_names, database);
  if (!options_.leave_one_out) {
    const auto is_query = [this](const ModelImage& image) { return IsQuery(image.name); };
    model_.images.erase(std::remove_if(model_.images.begin(), model_.images.end(), is_query), model_.images.end());
  }
  for (const ModelImage& image : model_.images) {
    if (const DatabaseImage* stored = FindInDatabase(image.name))
      posed_of_database_id_.emplace(stored->image_id, &image);
  }
  frame_of_database_image_ = DatabaseFramePlaces(model_, &database, options_.groups);
  if (!options_.pairs_path.empty()) ReadPairsFile(query_names);
}

void QuerySelection::ReadImages(const DatabaseReader& database) {
  std::vector<DamagedImage> damaged;
  for (DatabaseImage& image : database.ReadImages(&damaged)) {
    std::string name = image.name;
    database_images_.emplace(std::move(name), std::move(image));
  }
  for (const DamagedImage& image : damaged) {
    warnings_.push_back(database.Path().string() + ": " + image.damage + ": leaving the image out");
    if (image.name.empty()) {
      damage_of_unknown_image_ = image.damage;
    } else {
      damage_of_image_.emplace(image.name, image.damage);
    }
  }
}

std::string QuerySelection::DamageOf(const std::string& name) const {
  if (database_images_.count(name) > 0) return "";
  const auto damage = damage_of_image_.find(name);
  // An image that is not found may be the one whose name cannot be read.
  return damage == damage_of_image_.end() ? damage_of_unknown_image_ : damage->second;
}

std::vector<std::string> QuerySelection::AddQueries(const DatabaseReader& database) {
  std::unordered_map<std::string, const ModelImage*> posed_images;
  for (const ModelImage& image : model_.images) posed_images.emplace(image.name, &image);
  std::vector<QueryListEntry> entries;
  if (!options_.query_list_path.empty()) {
    entries = ReadQueryList(options_.query_list_path);  // keeps its order, because groups may be runs of the list
  } else {
    const auto add = [&](const std::string& name) {
      if ((posed_images.count(name) > 0) == options_.leave_one_out) entries.push_back({name, std::nullopt});
    };
    for (const auto& [name, image] : database_images_) add(name);
    for (const auto& [name, damage] : damage_of_image_) add(name);
    std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  }
  std::vector<std::string> names;
  for (const QueryListEntry& entry : entries) {
    const auto posed = posed_images.find(entry.name);
    const ModelImage* image = posed == posed_images.end() ? nullptr : posed->second;
    if (IsPhoto(entry.name, database)) {
      AddPhoto(entry, image, database);
    } else {
      AddStoredQuery(entry, image, database);
    }
    names.push_back(entry.name);
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
    return database.ReadKeypoints(image->image_id).empty();
  } catch (const DamagedRecordError&) {
    return false;  // because the image has keypoints
  }
}

void QuerySelection::AddPhoto(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database) {
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
      photo.camera = ReadUsableCamera(database, *image);
    } catch (const DamagedRecordError& error) {
      photo.damage = error.Damage();
    }
  }
  photos_.emplace(entry.name, std::move(photo));
}

void QuerySelection::AddStoredQuery(const QueryListEntry& entry, const ModelImage* posed,
                                    const DatabaseReader& database) {
  const DatabaseImage* image = FindInDatabase(entry.name);
  StoredQuery query;
  query.damage = DamageOf(entry.name);
  if (image == nullptr && query.damage.empty()) {
    throw InputError("--query_list_path: query " + entry.name + " is not in the database " + database.Path().string());
  }
  if (options_.leave_one_out && posed == nullptr) {
    throw InputError("--query_list_path: query " + entry.name +
                     " has no pose in --input_path, but --LazyLocalizer.leave_one_out needs one");
  }
  if (image != nullptr) {
    query.image = *image;
    try {
      ChooseCamera(entry, posed, database, &query);
    } catch (const DamagedRecordError& error) {
      query.damage = error.Damage();
    }
  }
  stored_queries_.emplace(entry.name, std::move(query));
}

void QuerySelection::ChooseCamera(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database,
                                  StoredQuery* query) const {
  query->stored_camera = database.ReadCamera(query->image.camera_id);
  if (entry.camera) {
    query->camera = *entry.camera;
  } else if (posed != nullptr) {
    query->camera = model_.cameras.at(posed->camera_id);
    query->source = IntrinsicsSource::MODEL;
    query->camera.has_prior_focal_length = query->stored_camera.has_prior_focal_length;  // models do not store it
  } else {
    query->camera = ReadUsableCamera(database, query->image);
    query->intrinsics_origin = OriginOfStoredCamera(query->camera);
    query->source = IntrinsicsSource::DATABASE;
  }
}

void QuerySelection::GroupAll(const std::vector<std::string>& query_names, const DatabaseReader& database) {
  groups_ = GroupQueries(query_names, database, model_, options_.groups);
  warnings_.insert(warnings_.end(), groups_.warnings.begin(), groups_.warnings.end());
  for (size_t group = 0; group < groups_.groups.size(); ++group) {
    for (const QueryFrame& frame : groups_.groups[group]) {
      for (const QueryFrame::Image& image : frame.images) {
        const auto query = stored_queries_.find(image.name);
        (query != stored_queries_.end() ? query->second.group : photos_.at(image.name).group) = group;
      }
    }
  }
}

void QuerySelection::ReadPairsFile(const std::vector<std::string>& query_names) {
  const auto is_known = [this](const std::string& name) {
    return database_images_.count(name) > 0 || photos_.count(name) > 0;
  };
  QueryPairs pairs = ReadPairs(options_.pairs_path, {query_names.begin(), query_names.end()}, is_known);
  listed_pairs_ = std::move(pairs.other_names);
  for (auto& [name, photo] : photos_) photo.pair_names = listed_pairs_[name];
  if (!pairs.unknown_names.empty()) {
    warnings_.push_back(options_.pairs_path + ": ignoring images that are not in the database: " +
                        std::to_string(pairs.unknown_names.size()) + ", for example " + *pairs.unknown_names.begin());
  }
}

std::optional<size_t> QuerySelection::FindGroup(const std::string& query_name) const {
  if (const StoredQuery* query = FindStoredQuery(query_name)) return query->group;
  const auto photo = photos_.find(query_name);
  return photo == photos_.end() ? std::nullopt : std::make_optional(photo->second.group);
}

const StoredQuery* QuerySelection::FindStoredQuery(const std::string& name) const {
  const auto query = stored_queries_.find(name);
  return query == stored_queries_.end() ? nullptr : &query->second;
}

const DatabaseImage* QuerySelection::FindInDatabase(const std::string& name) const {
  const auto image = database_images_.find(name);
  return image == database_images_.end() ? nullptr : &image->second;
}

const ModelImage* QuerySelection::FindPosedImage(uint32_t image_id, const StoredQuery& query) const {
  const auto posed = posed_of_database_id_.find(image_id);
  if (posed == posed_of_database_id_.end()) return nullptr;
  const StoredQuery* other_query = FindStoredQuery(posed->second->name);
  return other_query != nullptr && other_query->group == query.group ? nullptr : posed->second;
}

const ModelImage* QuerySelection::FindPosedImage(uint32_t image_id, const std::string& query_name) const {
  if (const StoredQuery* query = FindStoredQuery(query_name)) return FindPosedImage(image_id, *query);
  const auto posed = posed_of_database_id_.find(image_id);
  return posed == posed_of_database_id_.end() ? nullptr : posed->second;
}

const std::vector<std::string>* QuerySelection::ListedPairs(const std::string& query_name) const {
  static const std::vector<std::string> kNone;
  if (options_.pairs_path.empty()) return nullptr;
  const auto pairs = listed_pairs_.find(query_name);
  return pairs == listed_pairs_.end() ? &kNone : &pairs->second;
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
