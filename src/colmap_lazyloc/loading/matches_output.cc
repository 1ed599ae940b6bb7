#include "colmap_lazyloc/loading/matches_output.h"

#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/free_ids.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

// Returns the folder of a file that must not exist yet.
fs::path FolderOfNewFile(const fs::path& path) {
  if (IsTaken(path)) {
    throw InputError(path.string() +
                     ": exists already, but --LazyLocalizer.Advanced.matches_output_path makes a new database");
  }
  return path.parent_path();
}

}  // namespace

MatchesOutput::MatchesOutput(const fs::path& path, const DatabaseReader& database,
                             const std::vector<std::string>& photo_names)
    : file_name_(path.filename().string()), staged_(FolderOfNewFile(path), path) {
  FreeIds image_ids, camera_ids;
  for (const DatabaseImage& image : database.ReadImages()) {
    image_ids.Use(image.image_id);
    camera_ids.Use(image.camera_id);
    database_images_.emplace(image.name, image);
  }
  for (const std::string& name : photo_names) photo_ids_.emplace(name, Ids());
  for (auto& [name, ids] : photo_ids_) {
    const auto known = database_images_.find(name);
    ids.image_id = known == database_images_.end() ? image_ids.Next() : known->second.image_id;
    ids.camera_id = camera_ids.Next();
  }
  output_ = std::make_unique<MatchDatabase>(staged_ / file_name_);
}

void MatchesOutput::AddDatabaseImage(const ImagePair& pair, const Features& features) {
  const DatabaseImage& image = database_images_.at(pair.other_name);
  if (!known_images_.insert(image.image_id).second) return;
  if (known_cameras_.insert(image.camera_id).second) {
    Camera camera = pair.other_camera;
    camera.camera_id = image.camera_id;
    output_->AddCamera(camera);
  }
  output_->AddImage(image.image_id, image.camera_id, image.name, features);
}

void MatchesOutput::Write(const LocalizationProblem& problem, const Features& photo_features,
                          const std::vector<std::shared_ptr<const Features>>& database_features) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Ids& ids = photo_ids_.at(problem.query_name);
  Camera camera = problem.query_camera;
  camera.camera_id = ids.camera_id;
  output_->AddCamera(camera);
  output_->AddImage(ids.image_id, ids.camera_id, problem.query_name, photo_features);
  for (size_t i = 0; i < problem.pairs.size(); ++i) {
    const ImagePair& pair = problem.pairs[i];
    AddDatabaseImage(pair, *database_features[i]);
    output_->AddPair(database_images_.at(pair.other_name).image_id, ids.image_id, pair.matches, *pair.geometry);
  }
}

void MatchesOutput::Publish() {
  output_->Close();
  staged_.Publish({file_name_});
}

}  // namespace lazyloc
