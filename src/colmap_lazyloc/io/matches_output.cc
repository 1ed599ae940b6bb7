#include "colmap_lazyloc/io/matches_output.h"

#include <algorithm>
#include <system_error>

#include "colmap_lazyloc/io/output_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

}  // namespace

MatchesOutput::MatchesOutput(const fs::path& path, const DatabaseReader& database,
                             const std::vector<std::string>& photo_names)
    : path_(path), staged_path_(path.string() + ".new") {
  std::error_code ignored;
  for (const fs::path& taken : {path_, staged_path_}) {
    if (fs::exists(fs::symlink_status(taken, ignored))) {
      throw InputError(taken.string() + ": exists already: --LazyLocalizer.matches_output_path makes a new database");
    }
  }
  uint32_t last_image_id = 0, last_camera_id = 0;
  for (const DatabaseImage& image : database.ReadImages()) {
    last_image_id = std::max(last_image_id, image.image_id);
    last_camera_id = std::max(last_camera_id, image.camera_id);
    database_images_.emplace(image.name, image);
  }
  for (const std::string& name : photo_names) photo_ids_.emplace(name, 0);
  for (auto& [name, image_id] : photo_ids_) {
    const auto known = database_images_.find(name);
    image_id = known == database_images_.end() ? ++last_image_id : known->second.image_id;
  }
  next_camera_id_ = last_camera_id + 1;
  OutputFile(staged_path_).Close();  // says why where it cannot be made
  output_ = std::make_unique<MatchDatabase>(staged_path_);
}

MatchesOutput::~MatchesOutput() {
  if (!output_) return;
  output_.reset();
  std::error_code ignored;
  for (const char* suffix : {"", "-wal", "-shm"}) fs::remove(staged_path_.string() + suffix, ignored);
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
  const uint32_t query_id = photo_ids_.at(problem.query_name);
  Camera camera = problem.query_camera;
  // By the photo's place among the names, whatever the order in which photos are done.
  camera.camera_id =
      next_camera_id_ + static_cast<uint32_t>(std::distance(photo_ids_.begin(), photo_ids_.find(problem.query_name)));
  output_->AddCamera(camera);
  output_->AddImage(query_id, camera.camera_id, problem.query_name, photo_features);
  for (size_t i = 0; i < problem.pairs.size(); ++i) {
    const ImagePair& pair = problem.pairs[i];
    AddDatabaseImage(pair, *database_features[i]);
    output_->AddPair(database_images_.at(pair.other_name).image_id, query_id, pair.matches, *pair.geometry);
  }
}

void MatchesOutput::Publish() {
  output_->Close();
  std::error_code error;
  fs::rename(staged_path_, path_, error);
  if (error) throw InputError(path_.string() + ": cannot be written: " + error.message());
  output_.reset();
}

}  // namespace lazyloc
