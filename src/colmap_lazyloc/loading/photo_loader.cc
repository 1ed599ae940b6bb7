#include "colmap_lazyloc/loading/photo_loader.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>
#include <system_error>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/loading/near_candidates.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// Number of database images whose keypoints tell the scales, because reading those of all images takes too long.
constexpr size_t kNumSampledImages = 50;
// Maximum number of database images that a photo is matched with one by one: an index is faster only for more.
constexpr size_t kMaxNumExhaustive = 50;

std::vector<double> ParseCameraParams(const std::string& text) {
  std::vector<double> params;
  std::istringstream stream(text);
  for (std::string word; std::getline(stream, word, ',');) {
    const std::optional<double> param = NumberFrom<double>(Trimmed(word));
    if (!param) throw InputError("option --ImageReader.camera_params: '" + word + "' is not a number");
    params.push_back(*param);
  }
  return params;
}

DefaultCamera ParseDefaultCamera(const PhotoOptions& options) {
  const std::optional<int> model_id = CameraModelId(options.camera_model);
  if (!model_id) {
    throw InputError("option --ImageReader.camera_model: unknown camera model " + options.camera_model);
  }
  DefaultCamera camera = {*model_id, ParseCameraParams(options.camera_params)};
  const bool has_params = !camera.params.empty();
  const std::vector<double> params = has_params ? camera.params : CameraFromFocalLength(*model_id, 1, 1, 1).params;
  const std::string problem = CameraProblem({0, *model_id, 1, 1, params, true});
  if (!problem.empty()) {
    throw InputError(std::string("option --ImageReader.camera_") + (has_params ? "params: " : "model: ") + problem);
  }
  return camera;
}

// Returns null if no candidate has this name. candidates: sorted by name.
const DatabaseCandidate* FindCandidate(const std::vector<DatabaseCandidate>& candidates, const std::string& name) {
  const auto found = std::lower_bound(
      candidates.begin(), candidates.end(), name,
      [](const DatabaseCandidate& candidate, const std::string& other) { return candidate.image->name < other; });
  return found == candidates.end() || found->image->name != name ? nullptr : &*found;
}

// Returns the candidates from the nearest viewpoints, nearest first, but the image itself. The viewpoint distance is
// the root of (2 sin(angle / 2))^2 + (displacement / d)^2. How far the scene is, is not known: d is the distance to the
// camera that is max_num places away, so that a walk is treated as a room is.
DatabaseCandidates NearestViewpoints(const std::vector<DatabaseCandidate>& candidates, const ModelImage& image,
                                     size_t max_num) {
  const Eigen::Vector3d centre = CamInWorld(image.cam_from_world);
  const Eigen::Quaterniond rotation = image.cam_from_world.rotation.normalized();
  DatabaseCandidates others;
  std::vector<double> displacements;
  for (const DatabaseCandidate& candidate : candidates) {
    if (candidate.image->name == image.name) continue;
    others.push_back(&candidate);
    displacements.push_back((CamInWorld(candidate.image->cam_from_world) - centre).norm());
  }
  if (others.empty()) return others;
  std::vector<double> sorted = displacements;
  const size_t place = std::min(max_num, sorted.size()) - 1;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(place), sorted.end());
  const double scale = std::max(sorted[place], std::numeric_limits<double>::min());
  std::vector<std::pair<double, const DatabaseCandidate*>> by_distance;
  for (size_t i = 0; i < others.size(); ++i) {
    const double angle_rad = AngularDistanceRad(rotation, others[i]->image->cam_from_world.rotation.normalized());
    by_distance.emplace_back(std::hypot(2 * std::sin(angle_rad / 2), displacements[i] / scale), others[i]);
  }
  std::sort(by_distance.begin(), by_distance.end());  // of equal ones, by address and so by name
  by_distance.resize(std::min(max_num, by_distance.size()));
  others.clear();
  for (const auto& [distance, candidate] : by_distance) others.push_back(candidate);
  return others;
}

std::string SizeText(uint64_t width, uint64_t height) { return std::to_string(width) + " x " + std::to_string(height); }

size_t NumBytes(const Features& features) {
  return features.keypoints.size() * sizeof(Keypoint) + static_cast<size_t>(features.descriptors.size());
}

}  // namespace

PhotoLoader::PhotoLoader(const DatabaseReader& database, const QuerySelection& selection, const PhotoOptions& options,
                         int seed, int num_threads)
    : selection_(selection),
      options_(options),
      seed_(seed),
      num_threads_(num_threads),
      database_path_(database.Path()),
      default_camera_(ParseDefaultCamera(options)),
      features_(NumBytes, options.CacheBytes()),
      coarse_features_([](const auto& features) { return features ? NumBytes(*features) : 0; }, options.CacheBytes()) {
  std::vector<std::string> damages;
  const FeatureReader features(database.Path());
  const DescriptorCounts counts = features.ReadDescriptorCounts(&damages);
  for (const std::string& damage : damages) {
    warnings_.push_back(database.Path().string() + ": " + damage + ": leaving the image out");
  }
  FindCandidates(counts);
  if (candidates_.empty() && !damages.empty()) {
    throw InputError(database.Path().string() + ": " + damages.front());  // for example, descriptors of another type
  }
  if (candidates_.empty()) {
    throw InputError(database.Path().string() + ": no posed image has descriptors to match photos with" +
                     (options.on_demand ? ", or a photo below --image_path" : " (run COLMAP's feature_extractor)"));
  }
  MeasureCandidates(counts.of_image, features);
  ChooseMethods(counts.type, features);
  if (!options.matches_output_path.empty()) {
    std::vector<std::string> names;
    for (const auto& [name, photo] : selection.Photos()) names.push_back(name);
    matches_output_ = std::make_unique<MatchesOutput>(options.matches_output_path, database, names);
  }
}

void PhotoLoader::FindCandidates(const DescriptorCounts& counts) {
  const std::filesystem::path image_path = options_.image_path;
  for (const ModelImage& image : selection_.DatabaseModel().images) {
    const DatabaseImage* row = selection_.FindInDatabase(image.name);
    if (row == nullptr) continue;
    const bool is_stored = counts.of_image.count(row->image_id) > 0;
    std::error_code error;
    if (!is_stored && !(options_.on_demand && std::filesystem::is_regular_file(image_path / image.name, error)))
      continue;
    candidates_.push_back({&image, row->image_id, is_stored});
  }
}

const RetrievalIndex& PhotoLoader::Index() const {
  const std::lock_guard<std::mutex> lock(index_mutex_);
  if (!index_) index_ = MakeIndex();
  return *index_;
}

std::unique_ptr<RetrievalIndex> PhotoLoader::MakeIndex() const {
  const std::string& path = options_.retrieval_index_path;
  if (!extracted_) {
    return std::make_unique<RetrievalIndex>(path, DatabaseReader(database_path_), RetrievalOptions(), seed_,
                                            num_threads_);
  }
  std::map<uint32_t, std::string> names;
  for (const Candidate& candidate : candidates_) {
    if (extracted_->HasFile(candidate.image->name)) names.emplace(candidate.image_id, candidate.image->name);
  }
  IdleThreads idle_threads(EffectiveNumThreads(num_threads_) - 1);
  const CoarseFeatures features(*coarse_, names, &idle_threads);
  return std::make_unique<RetrievalIndex>(path, selection_.DatabaseImages(), features, RetrievalOptions(), seed_,
                                          num_threads_);
}

std::vector<std::string> PhotoLoader::Warnings() const {
  const std::lock_guard<std::mutex> lock(index_mutex_);
  std::vector<std::string> warnings = warnings_;
  if (index_) warnings.insert(warnings.end(), index_->Warnings().begin(), index_->Warnings().end());
  return warnings;
}

void PhotoLoader::ChooseMethods(FeatureType type, const FeatureReader& reader) {
  const std::string database_path = reader.Path().string();
  FeatureOptions feature_options = options_.features;
  feature_options.sift.turns_photos = reader.HasGravity();
  methods_ = MakeFeatureMethods(type, statistics_, database_scale_, database_path, feature_options);
  if (options_.on_demand) {
    if (type != FeatureType::SIFT) {
      throw InputError(database_path + ": has features of type " + EnumName(type) +
                       ", but --LazyLocalizer.Advanced.on_demand extracts those of SIFT");
    }
    const std::string& index_path = options_.retrieval_index_path;
    extracted_.emplace(*methods_.database, options_.image_path, index_path.empty() ? "" : index_path + ".features");
    coarse_.emplace(options_.image_path, index_path.empty() ? "" : index_path + ".coarse");
  }
  if (type != FeatureType::SIFT && !options_.matches_output_path.empty() && !MatchDatabase::CanHold(type)) {
    throw InputError(database_path + ": has features of type " + EnumName(type) +
                     ", which no database for --LazyLocalizer.Advanced.matches_output_path can hold, because "
                     "this program was built against COLMAP 3");
  }
  if (!methods_.fallback) return;
  fallback_ = std::make_unique<const FallbackFeatures>(selection_, options_, *methods_.fallback, type, seed_);
  const auto has_file = [this](const Candidate& candidate) { return fallback_->HasFile(candidate); };
  if (std::any_of(candidates_.begin(), candidates_.end(), has_file)) return;
  warnings_.push_back("none of the database images is below --image_path " + options_.image_path +
                      ": photos are not matched by " + EnumName(methods_.fallback->Type()) + " features");
}

void PhotoLoader::MeasureCandidates(const std::map<uint32_t, size_t>& num_descriptors, const FeatureReader& reader) {
  std::vector<size_t> counts;
  std::vector<double> sizes, focal_lengths, scale_ratios;
  const size_t step = std::max<size_t>(1, candidates_.size() / kNumSampledImages);
  for (size_t i = 0; i < candidates_.size(); ++i) {
    const Camera& camera = selection_.DatabaseModel().cameras.at(candidates_[i].image->camera_id);
    sizes.push_back(static_cast<double>(std::max(camera.width, camera.height)));
    focal_lengths.push_back(MeanFocalLength(camera));
    // What the database has already must not matter if the rest is extracted on demand.
    if (options_.on_demand) continue;
    counts.push_back(num_descriptors.at(candidates_[i].image_id));
    if (i % step != 0) continue;
    try {
      for (const Keypoint& keypoint : reader.ReadKeypoints(candidates_[i].image_id)) {
        scale_ratios.push_back(KeypointScale(keypoint) / focal_lengths.back());
      }
    } catch (const DamagedRecordError&) {
      // A photo that is compared with the image reports it.
    }
  }
  statistics_ = MeasureFeatures(std::move(counts), std::move(scale_ratios));
  database_scale_ = {Median(sizes), Median(focal_lengths)};
}

std::string PhotoLoader::DescribeExtraction() const {
  if (methods_.is_fallback_first) return "photos" + methods_.fallback->Describe();
  return "photos" + methods_.database->Describe() +
         (fallback_ ? "; photos that these do not localize" + methods_.fallback->Describe() : "");
}

bool PhotoLoader::NeedsRetrieval(const PhotoQuery& photo) const {
  return !photo.paired_ids && (!options_.retrieval_index_path.empty() || candidates_.size() > kMaxNumExhaustive);
}

PhotoLoader::Candidates PhotoLoader::AllowedCandidates(const PhotoQuery& photo) const {
  Candidates allowed;
  for (const Candidate& candidate : candidates_) {
    const auto& listed = photo.paired_ids;
    if (listed && !std::binary_search(listed->begin(), listed->end(), candidate.image_id)) continue;
    allowed.push_back(&candidate);
  }
  return allowed;
}

DatabaseCandidates PhotoLoader::FindNear(const PhotoQuery& photo, const std::optional<PositionPrior>& position) const {
  if (!position || !NeedsRetrieval(photo)) return {};
  // The file of matches holds what a photo is compared with first, which must not be a wrong place.
  if (matches_output_) return {};
  // Other features are compared with few images only, because this takes longer.
  if (methods_.is_fallback_first || !methods_.database->HasGuidedMatching()) return {};
  return FindNearCandidates(*position, candidates_);
}

PhotoLoader::Candidates PhotoLoader::ChooseMostAlike(const Candidates& near, const Features& features,
                                                     size_t num_retrieved, IdleThreads* idle_threads) const {
  std::vector<std::shared_ptr<const std::optional<Features>>> coarse(near.size());
  ParallelFor(
      near.size(),
      [&](size_t i) {
        coarse[i] = coarse_features_.Get(near[i]->image_id, [&] { return coarse_->Get(near[i]->image->name); });
      },
      idle_threads);
  Candidates chosen;
  const std::vector<size_t> counts = CountCoarseMatches(features, coarse, idle_threads);
  for (const size_t i : IndicesOfLargest(counts, num_retrieved)) chosen.push_back(near[i]);
  return chosen;
}

PhotoLoader::Candidates PhotoLoader::ChooseCandidates(const PhotoQuery& photo, const Candidates& near,
                                                      const Features& features, size_t num_retrieved,
                                                      IdleThreads* idle_threads) const {
  if (!near.empty()) return coarse_ ? ChooseMostAlike(near, features, num_retrieved, idle_threads) : near;
  if (!NeedsRetrieval(photo)) return AllowedCandidates(photo);
  std::map<uint32_t, const Candidate*> candidate_of_id;
  for (const Candidate& candidate : candidates_) candidate_of_id.emplace(candidate.image_id, &candidate);
  Candidates chosen;
  for (const uint32_t image_id : Index().Query(features, idle_threads)) {
    if (chosen.size() == num_retrieved) break;
    const auto candidate = candidate_of_id.find(image_id);
    if (candidate != candidate_of_id.end()) chosen.push_back(candidate->second);
  }
  std::sort(chosen.begin(), chosen.end());  // by address and so by name, because candidates_ is sorted by name
  return chosen;
}

PhotoFile PhotoLoader::ReadFile(const PhotoQuery& photo, const FeatureMethod& method, QueryRecord* record) const {
  if (photo.file) return *photo.file;
  const std::filesystem::path path =
      std::filesystem::path(options_.image_path) / (photo.path.empty() ? photo.name : photo.path);
  const std::optional<PhotoFile> file =
      Timed("extraction", &record->seconds, [&] { return PhotoFile::Read(path, method.NeedsColours()); });
  if (!file) {
    throw Refusal{QueryStatus::UNREADABLE_IMAGE, path.string() + " does not exist or is not a readable image"};
  }
  if (file->Properties().is_mirrored) {
    throw Refusal{QueryStatus::UNREADABLE_IMAGE,
                  path.string() + " is stored as a mirror image, as EXIF says, which no pose fits: mirror its pixels"};
  }
  return *file;
}

DatabaseFeatures PhotoLoader::AddPairs(const Candidates& candidates, const FeatureReader& features,
                                       IdleThreads* idle_threads, LocalizationProblem* problem,
                                       QueryRecord* record) const {
  const StageTimer timer("load", &record->seconds);
  const DatabaseFeatures extracted = ExtractOnDemand(candidates, features, idle_threads);
  DatabaseFeatures database_features;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& candidate = *candidates[i];
    try {
      database_features.push_back(
          extracted[i] ? extracted[i] : features_.Get(candidate.image_id, [&] { return Read(candidate, features); }));
      problem->pairs.push_back(selection_.MakePair(*candidate.image));
    } catch (const DamagedRecordError& error) {
      record->damages.push_back(error.Damage());
    }
  }
  return database_features;
}

LocalizationProblem PhotoLoader::Load(const PhotoQuery& photo, const Attempt& attempt, const DatabaseCandidates& near,
                                      const FeatureReader& features, IdleThreads* idle_threads,
                                      QueryRecord* record) const {
  const FeatureMethod& method = *methods_.database;
  const PhotoFile file = ReadFile(photo, method, record);
  const PhotoProperties& properties = file.Properties();
  PhotoCamera chosen = photo.camera
                           ? PhotoCamera{*photo.camera, photo.source}
                           : ChoosePhotoCamera(properties, default_camera_, selection_.CamerasLike(properties));
  const SharedCamera* const shared = FindSharedCamera(attempt.shared_cameras, chosen.camera, chosen.Origin());
  if (shared != nullptr) chosen = {shared->camera, IntrinsicsSource::JOINT};
  if (attempt.only_unknown_cameras && IsOfThisCamera(chosen.Origin())) throw Refusal{QueryStatus::NO_PAIRS, ""};
  record->intrinsics_source = chosen.source;
  if (chosen.camera.width != properties.width || chosen.camera.height != properties.height) {
    throw Refusal{QueryStatus::INCONSISTENT_INTRINSICS,
                  "the intrinsics are for " + SizeText(chosen.camera.width, chosen.camera.height) +
                      " pixels, but the photo has " + SizeText(properties.width, properties.height)};
  }
  const Features query_features = Timed("extraction", &record->seconds, [&] {
    const double focal_length_px = MeanFocalLength(chosen.camera);
    // The file of matches holds all features.
    const bool needs_all = attempt.compares_all_features || matches_output_;
    return needs_all ? method.Extract(file, focal_length_px, idle_threads)
                     : method.ExtractFirst(file, focal_length_px, idle_threads);
  });
  record->matcher = method.Matcher();
  LocalizationProblem problem;
  problem.query_name = photo.name;
  problem.query_camera = chosen.camera;
  problem.intrinsics_origin = chosen.Origin();
  if (shared != nullptr) problem.intrinsics_covariance = shared->covariance;
  problem.query_keypoints = record->keypoints = Positions(query_features.keypoints);
  DatabaseFeatures database_features;
  if (!problem.query_keypoints.empty()) {
    const Candidates candidates = Timed("retrieval", &record->seconds, [&] {
      return ChooseCandidates(photo, near, query_features, static_cast<size_t>(attempt.num_retrieved), idle_threads);
    });
    database_features = AddPairs(candidates, features, idle_threads, &problem, record);
    const bool needs_matches = !methods_.is_fallback_first || matches_output_;
    if (needs_matches) {
      PairMatchingOptions matching;
      matching.seed = seed_;
      matching.compares_all = attempt.compares_all_features;
      if (!photo.paired_ids) matching.max_num_verified = attempt.num_retrieved;
      MatchPairs(method, query_features, database_features, matching, idle_threads, &problem, &record->seconds);
    }
  }
  if (matches_output_ && attempt.writes_matches) {
    Timed("matches_output", &record->seconds,
          [&] { matches_output_->Write(problem, query_features, database_features); });
  }
  return methods_.is_fallback_first ? LoadFallback(photo, problem, features, idle_threads, record) : problem;
}

Features PhotoLoader::Read(const Candidate& candidate, const FeatureReader& features) const {
  if (candidate.is_stored) return features.Read(candidate.image_id);
  const ModelImage& image = *candidate.image;
  const Camera& camera = selection_.DatabaseModel().cameras.at(image.camera_id);
  std::optional<Features> extracted = extracted_->Get(image.name, camera);
  if (extracted) return std::move(*extracted);
  throw DamagedRecordError(options_.image_path, image.name + ": is not a readable image of the size of its camera, " +
                                                    SizeText(camera.width, camera.height));
}

DatabaseFeatures PhotoLoader::ExtractOnDemand(const Candidates& candidates, const FeatureReader& features,
                                              IdleThreads* idle_threads) const {
  DatabaseFeatures extracted(candidates.size());
  if (!extracted_) return extracted;
  ParallelFor(
      candidates.size(),
      [&](size_t i) {
        if (!candidates[i]->is_stored) extracted[i] = FeaturesOf(*candidates[i], features);
      },
      idle_threads);
  return extracted;
}

std::vector<Eigen::Vector2d> PhotoLoader::ExtractedKeypoints(const std::string& image_name) const {
  const Candidate* candidate = FindCandidate(candidates_, image_name);
  if (candidate == nullptr || candidate->is_stored) return {};
  const Camera& camera = selection_.DatabaseModel().cameras.at(candidate->image->camera_id);
  const std::optional<Features> extracted = extracted_->Get(image_name, camera);
  return extracted ? Positions(extracted->keypoints) : std::vector<Eigen::Vector2d>();
}

std::shared_ptr<const Features> PhotoLoader::FeaturesOf(const Candidate& candidate,
                                                        const FeatureReader& features) const {
  try {
    return features_.Get(candidate.image_id, [&] { return Read(candidate, features); });
  } catch (const DamagedRecordError&) {
    return nullptr;
  }
}

std::vector<ImagePair> PhotoLoader::MatchDatabaseImage(const ModelImage& image, int max_num_others,
                                                       const FeatureReader& features, IdleThreads* idle_threads) const {
  const Candidate* own = FindCandidate(candidates_, image.name);
  const std::shared_ptr<const Features> own_features = own == nullptr ? nullptr : FeaturesOf(*own, features);
  if (!own_features) return {};
  LocalizationProblem problem;
  problem.query_name = image.name;
  problem.query_camera = selection_.DatabaseModel().cameras.at(image.camera_id);
  problem.intrinsics_origin = IntrinsicsOrigin::MODEL;
  problem.query_keypoints = Positions(own_features->keypoints);
  QueryRecord unused;  // the seconds are those of the stage that calls
  const DatabaseFeatures others = AddPairs(NearestViewpoints(candidates_, image, static_cast<size_t>(max_num_others)),
                                           features, idle_threads, &problem, &unused);
  MatchPairs(*methods_.database, *own_features, others, {seed_}, idle_threads, &problem, &unused.seconds);
  std::vector<ImagePair>& pairs = problem.pairs;
  const auto is_useless = [](const ImagePair& pair) {
    return !HoldsCalibrated(pair.geometry->config) ||
           static_cast<int>(pair.geometry->inlier_matches.size()) < kMinNumInliers;
  };
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_useless), pairs.end());
  return std::move(pairs);
}

LocalizationProblem PhotoLoader::LoadFallback(const PhotoQuery& photo, const LocalizationProblem& first,
                                              const FeatureReader& features, IdleThreads* idle_threads,
                                              QueryRecord* record) const {
  const PhotoFile file = ReadFile(photo, *methods_.fallback, record);
  Candidates candidates;
  for (const ImagePair& pair : first.pairs) {
    candidates.push_back(FindCandidate(candidates_, pair.other_name));
  }
  // Takes all images, if they are few, for a photo without any features of the first attempt.
  if (candidates.empty()) candidates = AllowedCandidates(photo);
  if (first.pairs.empty() && candidates.size() > kMaxNumExhaustive) candidates.clear();
  return fallback_->Load(file, first, candidates, features, idle_threads, record);
}

}  // namespace lazyloc
