#include "colmap_lazyloc/io/problem_loader.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <tuple>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Whether a geometry estimated with one camera holds for the other: equal but for the rounding of a text file.
bool AgreeOnIntrinsics(const Camera& a, const Camera& b) {
  if (a.model_id != b.model_id || a.params.size() != b.params.size()) return false;
  for (size_t i = 0; i < a.params.size(); ++i) {
    if (std::abs(a.params[i] - b.params[i]) > 1e-6 * (1e-3 + std::abs(a.params[i]))) return false;
  }
  return true;
}

Camera ReadUsableCamera(const DatabaseReader& database, const DatabaseImage& image) {
  Camera camera = database.ReadCamera(image.camera_id);
  const std::string problem = CameraProblem(camera);
  if (!problem.empty()) {
    throw InputError(database.Path().string() + ": camera " + std::to_string(image.camera_id) + " of image " +
                     image.name + ": " + problem);
  }
  return camera;
}

// Matches.query_point names keypoints of the image `name`, other_point those of the pair's image.
void CheckMatches(const Matches& matches, const std::string& name, size_t num_keypoints, const ImagePair& pair,
                  const DatabaseReader& database) {
  for (const Match& match : matches) {
    if (match.query_point >= num_keypoints || match.other_point >= pair.other_keypoints.size()) {
      throw InputError(database.Path().string() + ": a match between " + name + " and " + pair.other_name +
                       " names a keypoint that its image does not have");
    }
  }
}

void CheckMatches(const LocalizationProblem& problem, const ImagePair& pair, const DatabaseReader& database) {
  const size_t num_keypoints = problem.query_keypoints.size();
  if (pair.geometry) {
    CheckMatches(pair.geometry->inlier_matches, problem.query_name, num_keypoints, pair, database);
  }
  CheckMatches(pair.matches, problem.query_name, num_keypoints, pair, database);
}

}  // namespace

ProblemLoader::ProblemLoader(const DatabaseReader& database, Model model, const std::vector<QueryListEntry>& queries,
                             const std::filesystem::path& pairs_path, const ProblemLoaderOptions& options)
    : model_(std::move(model)), options_(options) {
  for (DatabaseImage& image : database.ReadImages()) {
    std::string name = image.name;
    database_images_.emplace(std::move(name), std::move(image));
  }
  ChooseQueries(queries, database);
  if (!options_.leave_one_out) {
    const auto is_query = [&](const ModelImage& image) {
      return queries_.count(image.name) > 0 || photos_.count(image.name) > 0;
    };
    model_.images.erase(std::remove_if(model_.images.begin(), model_.images.end(), is_query), model_.images.end());
  }
  for (const ModelImage& image : model_.images) {
    const auto stored = database_images_.find(image.name);
    if (stored != database_images_.end()) posed_of_database_id_.emplace(stored->second.image_id, &image);
  }
  if (!pairs_path.empty()) {
    has_pairs_file_ = true;
    QueryPairs pairs = ReadPairs(pairs_path, {query_names_.begin(), query_names_.end()}, [&](const std::string& name) {
      return database_images_.count(name) > 0 || photos_.count(name) > 0;
    });
    pairs_ = std::move(pairs.partners);
    for (auto& [name, photo] : photos_) photo.partner_names = pairs_[name];
    if (!pairs.unknown_names.empty()) {
      warnings_.push_back(pairs_path.string() +
                          ": left out what the database lacks: " + std::to_string(pairs.unknown_names.size()) +
                          " images, such as " + *pairs.unknown_names.begin());
    }
  }
}

void ProblemLoader::ChooseQueries(const std::vector<QueryListEntry>& queries, const DatabaseReader& database) {
  std::unordered_map<std::string, const ModelImage*> posed_images;
  for (const ModelImage& image : model_.images) posed_images.emplace(image.name, &image);
  std::vector<QueryListEntry> chosen = queries;
  if (queries.empty()) {
    for (const auto& [name, image] : database_images_) {
      if ((posed_images.count(name) > 0) == options_.leave_one_out) chosen.push_back({name, std::nullopt});
    }
  }
  // Groups are runs of the list.
  if (queries.empty()) {
    std::sort(chosen.begin(), chosen.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  }
  for (const QueryListEntry& entry : chosen) {
    const auto posed = posed_images.find(entry.name);
    AddQuery(entry, posed == posed_images.end() ? nullptr : posed->second, database);
  }
  if (!query_names_.empty()) return ChooseGroups(database);
  throw InputError(database.Path().string() + ": " +
                   (options_.leave_one_out ? "no posed image of --input_path is in the database"
                                           : "every image has a pose in --input_path: nothing to localize (see "
                                             "--query_list_path, --LazyLocalizer.leave_one_out)"));
}

void ProblemLoader::ChooseGroups(const DatabaseReader& database) {
  QueryGroups grouped = GroupQueries(query_names_, database, model_, options_.groups);
  groups_ = std::move(grouped.groups);
  if (!grouped.warning.empty()) warnings_.push_back(std::move(grouped.warning));
  for (size_t group = 0; group < groups_.size(); ++group) {
    for (const QueryFrame& frame : groups_[group]) {
      for (const QueryFrame::Image& image : frame.images) {
        const auto query = queries_.find(image.name);
        if (query != queries_.end()) query->second.group = group;
      }
    }
  }
  std::sort(query_names_.begin(), query_names_.end());
}

bool ProblemLoader::IsPhoto(const std::string& name, const DatabaseReader& database) const {
  if (!options_.has_photos || options_.leave_one_out) return false;
  const auto image = database_images_.find(name);
  return image == database_images_.end() || database.ReadKeypoints(image->second.image_id).empty();
}

void ProblemLoader::AddQuery(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database) {
  const auto image = database_images_.find(entry.name);
  if (IsPhoto(entry.name, database)) {
    PhotoQuery photo = {entry.name, entry.camera, std::nullopt};
    if (!photo.camera && posed != nullptr) photo.camera = model_.cameras.at(posed->camera_id);
    if (!photo.camera && image != database_images_.end()) photo.camera = ReadUsableCamera(database, image->second);
    query_names_.push_back(entry.name);
    photos_.emplace(entry.name, std::move(photo));
    return;
  }
  if (image == database_images_.end()) {
    throw InputError("--query_list_path: query " + entry.name + " is not in the database " + database.Path().string());
  }
  if (options_.leave_one_out && posed == nullptr) {
    throw InputError("--query_list_path: query " + entry.name +
                     " has no pose in --input_path, which --LazyLocalizer.leave_one_out needs");
  }
  Query query;
  query.image = image->second;
  query.stored_camera = database.ReadCamera(query.image.camera_id);
  if (entry.camera) {
    query.camera = *entry.camera;
  } else if (posed != nullptr) {
    query.camera = model_.cameras.at(posed->camera_id);
    query.camera.has_prior_focal_length = query.stored_camera.has_prior_focal_length;  // models do not say
  } else {
    query.camera = ReadUsableCamera(database, query.image);
  }
  query_names_.push_back(entry.name);
  queries_.emplace(entry.name, std::move(query));
}

ProblemLoader::Candidates ProblemLoader::RankCandidates(const Query& query, const std::vector<PairSize>& sizes) const {
  Candidates candidates;
  for (const PairSize& size : sizes) {
    const auto posed = posed_of_database_id_.find(size.image_id);
    if (posed == posed_of_database_id_.end()) continue;
    // Left out with the query, where posed images are queries.
    const auto other = queries_.find(posed->second->name);
    if (other != queries_.end() && other->second.group == query.group) continue;
    candidates.push_back({posed->second, size.image_id, size.num_matches});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(b.num_matches, a.image->name) < std::tie(a.num_matches, b.image->name);
  });
  return candidates;
}

ProblemLoader::Candidates ProblemLoader::ListedCandidates(const Query& query) const {
  const auto pairs = pairs_.find(query.image.name);
  if (pairs == pairs_.end()) return {};
  std::vector<PairSize> listed;
  for (const std::string& name : pairs->second) {
    const auto image = database_images_.find(name);
    if (image != database_images_.end()) listed.push_back({image->second.image_id, 0});
  }
  return RankCandidates(query, listed);
}

std::optional<ImagePair> ProblemLoader::LoadPair(const Query& query, const StoredImage& other,
                                                 const DatabaseReader& database) const {
  const uint32_t query_id = query.image.image_id, other_id = other.image.image_id;
  ImagePair pair;
  pair.geometry = database.ReadTwoViewGeometry(query_id, other_id);
  if (pair.geometry && pair.geometry->inlier_matches.empty()) return std::nullopt;
  if (!pair.geometry) {
    pair.matches = database.ReadMatches(query_id, other_id);
    if (pair.matches.empty()) return std::nullopt;
  }
  pair.other_name = other.image.name;
  pair.other_camera = other.camera;
  pair.other_keypoints = database.ReadKeypoints(other_id);
  const bool has_other_intrinsics =
      pair.geometry && (!AgreeOnIntrinsics(pair.geometry->query_camera.value_or(query.stored_camera), query.camera) ||
                        !AgreeOnIntrinsics(pair.geometry->other_camera.value_or(other.stored_camera), other.camera));
  // By which its inliers were chosen too: COLMAP estimates it again from all matches.
  if (has_other_intrinsics) pair.geometry->config = TwoViewConfig::UNCALIBRATED;
  if (has_other_intrinsics) pair.matches = database.ReadMatches(query_id, other_id);
  return pair;
}

void ProblemLoader::LoadPairs(const Query& query, const Candidates& candidates, size_t max_num_pairs,
                              const DatabaseReader& database, LocalizationProblem* problem) const {
  for (const Candidate& candidate : candidates) {
    if (problem->pairs.size() == max_num_pairs) return;
    const DatabaseImage& image = database_images_.at(candidate.image->name);
    std::optional<ImagePair> pair = LoadPair(
        query, {image, model_.cameras.at(candidate.image->camera_id), database.ReadCamera(image.camera_id)}, database);
    if (!pair) continue;
    pair->database_cam_from_world = candidate.image->cam_from_world;
    CheckMatches(*problem, *pair, database);
    problem->pairs.push_back(std::move(*pair));
  }
}

void ProblemLoader::LoadBestPairs(const Query& query, const DatabaseReader& database,
                                  LocalizationProblem* problem) const {
  const size_t num_wanted = options_.num_retrieved;
  const std::vector<PairSize> verified = database.ReadInlierCounts(query.image.image_id);
  LoadPairs(query, RankCandidates(query, verified), num_wanted, database, problem);
  if (problem->pairs.size() == num_wanted) return;
  const std::vector<PairSize> raw = database.ReadMatchCounts(query.image.image_id);
  std::vector<PairSize> unverified;
  std::set_difference(raw.begin(), raw.end(), verified.begin(), verified.end(), std::back_inserter(unverified),
                      [](const PairSize& a, const PairSize& b) { return a.image_id < b.image_id; });
  LoadPairs(query, RankCandidates(query, unverified), problem->pairs.size() + 2 * num_wanted, database, problem);
}

LocalizationProblem ProblemLoader::Load(const std::string& query_name, const DatabaseReader& database) const {
  const Query& query = queries_.at(query_name);
  LocalizationProblem problem;
  problem.query_name = query_name;
  problem.query_camera = query.camera;
  problem.query_keypoints = database.ReadKeypoints(query.image.image_id);
  if (problem.query_keypoints.empty()) return problem;
  if (has_pairs_file_) {
    const Candidates listed = ListedCandidates(query);
    LoadPairs(query, listed, listed.size(), database, &problem);
  } else {
    LoadBestPairs(query, database, &problem);
  }
  std::sort(problem.pairs.begin(), problem.pairs.end(),
            [](const ImagePair& a, const ImagePair& b) { return a.other_name < b.other_name; });
  return problem;
}

void ProblemLoader::LoadQueryPairs(const DatabaseReader& database, QueryGroup* group) const {
  group->has_rig_scale = options_.groups.trajectory_path.empty() || options_.groups.trajectory_has_scale;
  std::unordered_map<uint32_t, int> query_of_id;
  for (int query = 0; group->images.size() > 1 && query < static_cast<int>(group->images.size()); ++query) {
    const LocalizationProblem& problem = group->images[query].problem;
    const auto stored = queries_.find(problem.query_name);
    if (stored == queries_.end()) continue;  // a photo
    const uint32_t image_id = stored->second.image.image_id;
    std::set<int> others;  // earlier queries
    const auto add = [&](uint32_t other_id) {
      const auto other = query_of_id.find(other_id);
      if (other != query_of_id.end()) others.insert(other->second);
    };
    if (!has_pairs_file_) {
      for (const PairSize& size : database.ReadInlierCounts(image_id)) add(size.image_id);
      for (const PairSize& size : database.ReadMatchCounts(image_id)) add(size.image_id);
    } else if (const auto listed = pairs_.find(problem.query_name); listed != pairs_.end()) {
      for (const std::string& name : listed->second) {
        if (const auto image = database_images_.find(name); image != database_images_.end())
          add(image->second.image_id);
      }
    }
    for (const int other : others) {
      const Query& other_query = queries_.at(group->images[other].problem.query_name);
      std::optional<ImagePair> pair = LoadPair(stored->second, other_query, database);
      if (!pair) continue;
      CheckMatches(problem, *pair, database);
      group->query_pairs.push_back({query, other, std::move(*pair)});
    }
    query_of_id.emplace(image_id, query);
  }
}

}  // namespace lazyloc
