#include "colmap_lazyloc/loading/query_source.h"

#include <utility>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool SourceOptions::Check(std::string* error) const {
  OPTION_GE(num_retrieved, 1);
  if (single_camera && single_camera_per_image) {
    *error = "ImageReader.single_camera and ImageReader.single_camera_per_image exclude each other";
    return false;
  }
  if (!photos.image_path.empty() && selection.leave_one_out) {
    *error = "image_path excludes --LazyLocalizer.leave_one_out, whose queries are posed images of the database";
    return false;
  }
  return selection.groups.Check(error) && photos.Check(error) && priors.Check(error) && depth.Check(error);
}

LoadedGroup LoadEach(const GroupInput& input, const LoadQueryFunction& load_query) {
  LoadedGroup loaded;
  loaded.group.has_rig_scale = input.has_rig_scale;
  for (const GroupInput::Frame& frame : input.frames) {
    const int frame_index = static_cast<int>(loaded.group.frame_names.size());
    for (const GroupInput::Image& image : frame.images) {
      QueryRecord record;
      try {
        LocalizationProblem problem = load_query(image, &record);
        problem.prior = image.prior;
        loaded.group.images.push_back({std::move(problem), frame_index, image.cam_from_rig});
        loaded.records.push_back(std::move(record));
      } catch (const Refusal& refusal) {
        record.result.priors = UntestedPriors(image.prior);
        loaded.refused.push_back({std::move(record), refusal});
      }
    }
    const bool has_images = !loaded.group.images.empty() && loaded.group.images.back().frame == frame_index;
    if (has_images) loaded.group.frame_names.push_back(frame.name);
  }
  return loaded;
}

QuerySource::QuerySource(const SourceOptions& options, Model model, int seed, int num_threads)
    : options_(options),
      seed_(seed),
      num_threads_(num_threads),
      database_(options.database_path),
      selection_(database_, std::move(model), options.selection, options.photos.image_path),
      pair_loader_(selection_),
      priors_(ReadQueryPriors(options.priors,
                              [this](const std::string& name) { return selection_.FindGroup(name).has_value(); })),
      rough_positions_(
          ReadQueryPriors({options.photos.position_path, "", ""},
                          [this](const std::string& name) { return selection_.Photos().count(name) > 0; })),
      neighbours_(selection_) {
  if (!options.depth.depth_path.empty()) depth_maps_.emplace(options.depth);
  if (!selection_.Photos().empty()) Photos();
}

const PhotoLoader& QuerySource::Photos() const {
  std::call_once(photo_loader_is_made_, [this] {
    photo_loader_ = std::make_unique<PhotoLoader>(database_, selection_, options_.photos, seed_, num_threads_);
    if (options_.selection.has_more_queries) photo_loader_->PrepareRetrieval({});
    for (const auto& [name, photo] : selection_.Photos()) {
      const auto prior = priors_.find(name);
      const auto position = RoughPosition(name, prior == priors_.end() ? QueryPrior() : prior->second);
      if (photo_loader_->FindNear(photo, position).empty()) photo_loader_->PrepareRetrieval(photo);
    }
  });
  return *photo_loader_;
}

QuerySource::Session::Session(const QuerySource& source, IdleThreads* threads)
    : database(source.database_.Path()), idle_threads(threads) {}

GroupInput QuerySource::Group(size_t group) const {
  GroupInput input;
  input.has_rig_scale = selection_.Groups().has_rig_scale;
  for (const QueryFrame& frame : selection_.Groups().At(group)) {
    input.frames.push_back({frame.name, {}});
    for (const QueryFrame::Image& image : frame.images) {
      input.frames.back().images.push_back({std::string(image.name), image.cam_from_rig});
    }
  }
  return input;
}

const PhotoQuery* QuerySource::FindPhoto(const QueryInput& query) const {
  const auto* const name = std::get_if<std::string>(&query);
  if (name == nullptr) return std::get_if<PhotoQuery>(&query);
  const auto photo = selection_.Photos().find(*name);
  return photo == selection_.Photos().end() ? nullptr : &photo->second;
}

GroupInput QuerySource::WithPriors(GroupInput input) const {
  if (priors_.empty()) return input;
  for (GroupInput::Frame& frame : input.frames) {
    for (GroupInput::Image& image : frame.images) {
      const auto* name = std::get_if<std::string>(&image.query);
      const auto prior = name == nullptr ? priors_.end() : priors_.find(*name);
      if (prior == priors_.end()) continue;
      if (!image.prior.position) image.prior.position = prior->second.position;
      if (!image.prior.gravity) image.prior.gravity = prior->second.gravity;
    }
  }
  return input;
}

std::optional<PositionPrior> QuerySource::RoughPosition(const std::string& photo_name, const QueryPrior& prior) const {
  const auto rough = rough_positions_.find(photo_name);
  return rough == rough_positions_.end() ? prior.position : rough->second.position;
}

bool QuerySource::HasNearImages(const GroupInput& input) const {
  for (const GroupInput::Frame& frame : WithPriors(input).frames) {
    for (const GroupInput::Image& image : frame.images) {
      const PhotoQuery* photo = FindPhoto(image.query);
      if (photo != nullptr && !Photos().FindNear(*photo, RoughPosition(photo->name, image.prior)).empty()) return true;
    }
  }
  return false;
}

LocalizationProblem QuerySource::LoadQuery(const GroupInput::Image& image, const Attempt& attempt, Session* session,
                                           QueryRecord* record) const {
  const QueryInput& query = image.query;
  if (const auto* problem = std::get_if<LocalizationProblem>(&query)) return *problem;
  LocalizationProblem problem;
  try {
    if (const PhotoQuery* photo = FindPhoto(query)) {
      record->result.query_name = photo->name;
      if (!photo->damage.empty()) throw DamagedRecordError(database_.Path().string(), photo->damage);
      const PhotoLoader& photos = Photos();
      if (!session->features) session->features = std::make_unique<FeatureReader>(database_.Path());
      DatabaseCandidates near;
      if (attempt.only_near) near = photos.FindNear(*photo, RoughPosition(photo->name, image.prior));
      problem = photos.Load(*photo, attempt, near, *session->features, session->idle_threads, record);
    } else {
      record->result.query_name = std::get<std::string>(query);
      const StageTimer timer("load", &record->seconds);
      StoredQuery stored = selection_.ReadStoredQuery(record->result.query_name, session->database);
      const auto* const shared = FindSharedCamera(attempt.shared_cameras, stored.camera, stored.intrinsics_origin);
      if (shared != nullptr) {
        stored.camera = shared->camera;
        stored.intrinsics_origin = IntrinsicsOrigin::JOINT;
        stored.source = IntrinsicsSource::JOINT;
      }
      if (attempt.only_unknown_cameras && IsOfThisCamera(stored.intrinsics_origin)) {
        throw Refusal{QueryStatus::NO_PAIRS, ""};
      }
      record->intrinsics_source = stored.source;
      problem = pair_loader_.Load(stored, attempt.num_retrieved, session->database, &record->damages);
      if (shared != nullptr) problem.intrinsics_covariance = shared->covariance;
    }
  } catch (const DamagedRecordError& error) {
    throw Refusal{QueryStatus::DAMAGED_DATA, error.Damage()};
  }
  // All pairs of a file are used.
  if (options_.selection.pairs_path.empty()) problem.max_num_pairs = attempt.num_retrieved;
  return problem;
}

Attempt QuerySource::FirstAttempt() const {
  Attempt attempt;
  attempt.num_retrieved = options_.num_retrieved;
  attempt.writes_matches = true;
  return attempt;
}

bool QuerySource::HasFurtherFeatures(const LoadedGroup& first) const {
  for (size_t i = 0; i < first.records.size(); ++i) {
    const bool is_photo = first.records[i].matcher.has_value();
    if (is_photo && Photos().HasFurtherFeatures(first.group.images[i].problem, first.records[i])) return true;
  }
  return false;
}

bool QuerySource::HasFallback(const GroupInput& input) const {
  for (const GroupInput::Frame& frame : input.frames) {
    for (const GroupInput::Image& image : frame.images) {
      if (FindPhoto(image.query) == nullptr || !Photos().HasFallback()) return false;
    }
  }
  return true;
}

LoadedGroup QuerySource::Load(const GroupInput& input, const Attempt& attempt, const LoadedGroup* first,
                              Session* session) const {
  LoadedGroup loaded;
  if (attempt.uses_fallback_features) {
    loaded = LoadFallback(input, *first, session);
  } else {
    loaded = LoadEach(WithPriors(input), [&](const GroupInput::Image& image, QueryRecord* record) {
      return LoadQuery(image, attempt, session, record);
    });
    pair_loader_.LoadQueryPairs(session->database, &loaded);
  }
  AddDatabasePairsAndDepths(session, &loaded);
  return loaded;
}

LoadedGroup QuerySource::LoadFallback(const GroupInput& input, const LoadedGroup& first, Session* session) const {
  LoadedGroup loaded = first;
  size_t num_loaded = 0;
  for (const GroupInput::Frame& frame : input.frames) {
    for (const GroupInput::Image& image : frame.images) {
      const PhotoQuery& photo = *FindPhoto(image.query);
      if (num_loaded == loaded.records.size()) break;
      LocalizationProblem& problem = loaded.group.images[num_loaded].problem;
      if (problem.query_name != photo.name) continue;  // it was refused
      QueryRecord& record = loaded.records[num_loaded++];
      record.seconds.clear();
      try {
        problem = Photos().LoadFallback(photo, problem, *session->features, session->idle_threads, &record);
      } catch (const Refusal&) {
        problem.pairs.clear();  // its file is gone since the first attempt
      }
    }
  }
  return loaded;
}

void QuerySource::AddDatabasePairsAndDepths(Session* session, LoadedGroup* loaded) const {
  if (options_.reads_database_pairs) {
    const auto match_now = [&](const ModelImage& image, int max_num_others) {
      return Photos().MatchDatabaseImage(image, max_num_others, *session->features, session->idle_threads);
    };
    neighbours_.AddTo(session->database, match_now, loaded);
  }
  if (!depth_maps_) return;
  for (QueryImage& query : loaded->group.images) {
    QueryRecord& record = loaded->records[&query - loaded->group.images.data()];
    const bool has_stored_keypoints = HasStoredKeypoints(record);
    const StageTimer timer("depth", &record.seconds);
    for (ImagePair& pair : query.problem.pairs) {
      const DatabaseImage* image = selection_.FindInDatabase(pair.other_name);
      if (image == nullptr) continue;
      pair.other_depths =
          depth_maps_->AtKeypoints(pair.other_name, image->image_id, pair.other_camera, pair.other_keypoints);
      if (pair.other_depths.empty()) continue;
      pair.other_point_depths = neighbours_.PointDepths(pair.other_name, query.problem.query_name, session->database);
      // Leaves out points of other keypoints than the stored ones, which a caller or fallback features may bring.
      if (!has_stored_keypoints || pair.other_point_depths.size() != pair.other_keypoints.size()) {
        pair.other_point_depths.clear();
      }
    }
  }
}

std::vector<std::string> QuerySource::Warnings() const {
  std::vector<std::string> warnings = selection_.Warnings();
  if (photo_loader_) {
    for (std::string& warning : photo_loader_->Warnings()) warnings.push_back(std::move(warning));
  }
  return warnings;
}

void QuerySource::PublishMatches() const {
  if (photo_loader_) photo_loader_->PublishMatches();
}

}  // namespace lazyloc
