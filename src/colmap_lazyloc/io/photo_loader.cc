#include "colmap_lazyloc/io/photo_loader.h"

#include <algorithm>
#include <set>
#include <sstream>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

std::vector<double> ParseCameraParams(const std::string& text) {
  std::vector<double> params;
  std::istringstream stream(text);
  for (std::string word; std::getline(stream, word, ',');) {
    size_t length = 0;
    try {
      params.push_back(std::stod(word, &length));
    } catch (const std::exception&) {
    }
    if (length == 0 || word.find_first_not_of(' ', length) != std::string::npos) {
      throw InputError("option --ImageReader.camera_params: '" + word + "' is not a number");
    }
  }
  return params;
}

std::string SizeText(uint64_t width, uint64_t height) { return std::to_string(width) + " x " + std::to_string(height); }

}  // namespace

bool PhotoLoaderOptions::Check(std::string* error) const {
  const auto check = [error](const auto& options, const char* group) {
    const bool is_good = options.Check(error);
    if (!is_good) *error = group + *error;
    return is_good;
  };
  return check(matching, "--LazyLocalizer.") && check(matching.extraction, "--SiftExtraction.") &&
         check(matching.matching, "--SiftMatching.") && check(retrieval, "--LazyIndexer.");
}

PhotoLoader::PhotoLoader(const DatabaseReader& database, const Model& database_model,
                         const std::map<std::string, PhotoQuery>& photos, int num_retrieved,
                         const PairMatchingOptions& pair_options, const PhotoLoaderOptions& options)
    : options_(options),
      pair_options_(pair_options),
      num_retrieved_(static_cast<size_t>(num_retrieved)),
      camera_params_(ParseCameraParams(options.camera_params)),
      cache_(options.matching.cache_gb) {
  const std::optional<int> model_id = CameraModelId(options.camera_model);
  if (!model_id) throw InputError("option --ImageReader.camera_model: unknown camera model " + options.camera_model);
  camera_model_id_ = *model_id;
  if (!camera_params_.empty()) {
    const std::string problem = CameraProblem({0, camera_model_id_, 1, 1, camera_params_, true});
    if (!problem.empty()) throw InputError("option --ImageReader.camera_params: " + problem);
  }
  if (!options.query_prior_path.empty()) priors_ = ReadQueryPriors(options.query_prior_path);

  const FeatureReader features(database.Path());
  const std::map<uint32_t, size_t> num_descriptors = features.ReadDescriptorCounts();
  const std::vector<DatabaseImage> images = database.ReadImages();
  std::map<std::string, uint32_t> described;
  for (const DatabaseImage& image : images) {
    if (num_descriptors.count(image.image_id) > 0) described[image.name] = image.image_id;
  }
  for (const ModelImage& image : database_model.images) {
    const auto found = described.find(image.name);
    if (found == described.end()) continue;
    views_.push_back({&image, &database_model.cameras.at(image.camera_id), found->second});
  }
  if (views_.empty()) {
    throw InputError(database.Path().string() +
                     ": no posed image has descriptors, which photos are matched with (run "
                     "COLMAP's feature_extractor)");
  }
  const bool needs_index =
      std::any_of(photos.begin(), photos.end(), [this](const auto& photo) { return NeedsRetrieval(photo.second); });
  if (needs_index) {
    index_ = std::make_unique<RetrievalIndex>(options.retrieval_index_path, images, features, options.retrieval);
  }
}

bool PhotoLoader::NeedsRetrieval(const PhotoQuery& photo) const {
  if (photo.partner_names) return false;
  return !options_.retrieval_index_path.empty() ||
         AllowedViews(photo).size() > static_cast<size_t>(options_.matching.max_num_exhaustive);
}

std::vector<const PhotoLoader::DatabaseView*> PhotoLoader::AllowedViews(const PhotoQuery& photo) const {
  std::set<std::string> listed;
  if (photo.partner_names) listed.insert(photo.partner_names->begin(), photo.partner_names->end());
  const auto prior = priors_.find(photo.name);
  std::vector<const DatabaseView*> allowed;
  for (const DatabaseView& view : views_) {
    if (photo.partner_names && listed.count(view.image->name) == 0) continue;
    if (prior != priors_.end()) {
      const Eigen::Vector3d distance = CamInWorld(view.image->cam_from_world) - prior->second.position;
      if (distance.norm() > prior->second.radius) continue;
    }
    allowed.push_back(&view);
  }
  return allowed;
}

std::vector<const PhotoLoader::DatabaseView*> PhotoLoader::ChooseViews(const PhotoQuery& photo,
                                                                       const Descriptors& descriptors,
                                                                       IdleThreads* idle_threads) const {
  std::vector<const DatabaseView*> allowed = AllowedViews(photo);
  if (!NeedsRetrieval(photo)) return allowed;
  std::map<uint32_t, const DatabaseView*> view_of_id;
  for (const DatabaseView* view : allowed) view_of_id.emplace(view->image_id, view);
  std::vector<const DatabaseView*> chosen;
  for (const uint32_t image_id : index_->Query(descriptors, idle_threads)) {
    if (chosen.size() == num_retrieved_) break;
    const auto view = view_of_id.find(image_id);
    if (view != view_of_id.end()) chosen.push_back(view->second);
  }
  std::sort(chosen.begin(), chosen.end());  // by address: views_ is sorted by name
  return chosen;
}

Camera PhotoLoader::CameraOf(const PhotoQuery& photo, const Photo& file) const {
  if (photo.camera) {
    if (photo.camera->width == file.width && photo.camera->height == file.height) return *photo.camera;
    throw PhotoFailure{QueryStatus::UNKNOWN_CAMERA,
                       "the camera is for " + SizeText(photo.camera->width, photo.camera->height) +
                           " pixels, but the photo has " + SizeText(file.width, file.height)};
  }
  if (!camera_params_.empty()) return {0, camera_model_id_, file.width, file.height, camera_params_, true};
  if (file.exif_focal_length_px) {
    return CameraFromFocalLength(camera_model_id_, *file.exif_focal_length_px, file.width, file.height);
  }
  throw PhotoFailure{QueryStatus::UNKNOWN_CAMERA,
                     "no intrinsics in --query_list_path, no --ImageReader.camera_params, no focal length in EXIF"};
}

LoadedPhoto PhotoLoader::Load(const PhotoQuery& photo, const FeatureReader& features, IdleThreads* idle_threads,
                              StageTimer::Seconds* seconds) const {
  const std::filesystem::path path = std::filesystem::path(options_.image_path) / photo.name;
  std::optional<Photo> file;
  {
    const StageTimer timer("extraction", seconds);
    file = ReadPhoto(path, options_.matching.extraction);
  }
  if (!file) {
    throw PhotoFailure{QueryStatus::UNREADABLE_IMAGE, path.string() + " is missing or no image that can be read"};
  }
  LoadedPhoto loaded;
  LocalizationProblem& problem = loaded.problem;
  problem.query_name = photo.name;
  problem.query_camera = CameraOf(photo, *file);
  loaded.features = std::make_shared<const Features>(std::move(file->features));
  problem.query_keypoints = Positions(loaded.features->keypoints);
  if (problem.query_keypoints.empty()) return loaded;

  std::vector<const DatabaseView*> views;
  {
    const StageTimer timer("retrieval", seconds);
    views = ChooseViews(photo, loaded.features->descriptors, idle_threads);
  }
  {
    const StageTimer timer("load", seconds);
    for (const DatabaseView* view : views) {
      ImagePair pair;
      pair.other_name = view->image->name;
      pair.other_camera = *view->camera;
      pair.database_cam_from_world = view->image->cam_from_world;
      problem.pairs.push_back(std::move(pair));
      loaded.database_features.push_back(cache_.Get(view->image_id, features));
    }
  }
  MatchPairs(*loaded.features, loaded.database_features, pair_options_, idle_threads, &problem, seconds);
  return loaded;
}

}  // namespace lazyloc
