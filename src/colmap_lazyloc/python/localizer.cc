#include "colmap_lazyloc/python/localizer.h"

#include <unistd.h>

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/cli/query_runner.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

void CheckFinite(const std::vector<Eigen::Vector2d>& keypoints, const std::string& owner) {
  for (size_t i = 0; i < keypoints.size(); ++i) {
    if (!keypoints[i].allFinite()) throw InputError(owner + ": keypoint " + std::to_string(i) + " is not finite");
  }
}

void CheckMatches(const Matches& matches, size_t num_query_points, size_t num_other_points, const std::string& owner) {
  for (const Match& match : matches) {
    if (match.query_point >= num_query_points || match.other_point >= num_other_points) {
      throw InputError(owner + ": match (" + std::to_string(match.query_point) + ", " +
                       std::to_string(match.other_point) + ") names a keypoint that its image does not have");
    }
  }
}

bool HasOnlyMatches(const GroupInput& input) {
  for (const GroupInput::Frame& frame : input.frames) {
    for (const GroupInput::Image& image : frame.images) {
      if (!std::holds_alternative<LocalizationProblem>(image.query)) return false;
    }
  }
  return true;
}

}  // namespace

// A call of a thread: counts the thread as busy and lends it a session.
class Localizer::Call {
 public:
  explicit Call(Localizer* localizer) : localizer_(*localizer), busy_(&localizer_.idle_threads_) {
    if (!localizer_.source_) return;
    {
      const std::lock_guard<std::mutex> lock(localizer_.sessions_mutex_);
      if (localizer_.process_ != getpid()) {
        // Leaves the parent's connections alone, because SQLite must not even close them in a forked process.
        for (auto& session : localizer_.sessions_) static_cast<void>(session.release());
        localizer_.sessions_.clear();
        localizer_.process_ = getpid();
      }
      if (!localizer_.sessions_.empty()) {
        session_ = std::move(localizer_.sessions_.back());
        localizer_.sessions_.pop_back();
      }
    }
    if (!session_) session_ = std::make_unique<QuerySource::Session>(*localizer_.source_, &localizer_.idle_threads_);
  }
  ~Call() {
    if (!session_) return;
    const std::lock_guard<std::mutex> lock(localizer_.sessions_mutex_);
    localizer_.sessions_.push_back(std::move(session_));
  }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  QuerySource::Session* Session() { return session_.get(); }

 private:
  Localizer& localizer_;
  const BusyThread busy_;                          // gives the thread back if no session can be opened, too
  std::unique_ptr<QuerySource::Session> session_;  // null without a database
};

Localizer::Localizer(const CommandOptions& options, std::optional<Model> model)
    : options_(options), idle_threads_(EffectiveNumThreads(options.num_threads)), process_(getpid()) {
  options_.source.selection.has_more_queries = true;
  Model read = model ? *std::move(model) : ReadModel(options_.source.input_path);
  if (options_.source.database_path.empty()) {
    if (!options_.source.depth.depth_path.empty()) throw InputError("option depth_path needs a database");
    model_ = std::move(read);
    frames_ = DatabaseFramePlaces(model_, nullptr, options_.source.selection.groups);
    return;
  }
  source_.reset(new QuerySource(MakeQuerySource(options_, std::move(read))));
}

std::vector<std::string> Localizer::Warnings() const {
  return source_ ? source_->Warnings() : std::vector<std::string>();
}

std::vector<std::string> Localizer::TakeDepthProblems() {
  std::vector<std::string> untold;
  if (!source_ || source_->Depths() == nullptr) return untold;
  const std::lock_guard<std::mutex> lock(sessions_mutex_);
  for (const std::string& problem : source_->Depths()->Problems()) {
    if (told_depth_problems_.insert(problem).second) untold.push_back(problem);
  }
  return untold;
}

std::vector<std::vector<std::string>> Localizer::Groups() const {
  std::vector<std::vector<std::string>> groups;
  if (!source_) return groups;
  for (size_t i = 0; i < source_->NumGroups(); ++i) {
    groups.emplace_back();
    for (const QueryFrame& frame : source_->Selection().Groups().At(i)) {
      for (const QueryFrame::Image& image : frame.images) groups.back().emplace_back(image.name);
    }
  }
  return groups;
}

size_t Localizer::FindGroup(const std::string& query_name) const {
  if (!source_) throw InputError("query " + query_name + " needs a database, but the Localizer has none");
  if (const std::optional<size_t> group = source_->Selection().FindGroup(query_name)) return *group;
  if (FindByName(DatabaseModel().images, query_name) != nullptr) {
    throw InputError("query " + query_name + " has a pose in the model (see LazyLocalizer.leave_one_out)");
  }
  if (source_->Selection().FindInDatabase(query_name) != nullptr) {
    throw InputError("query " + query_name + " is not in the list of queries");
  }
  throw InputError("query " + query_name + " is not in the database " + source_->Database().Path().string());
}

std::vector<Eigen::Vector2d> Localizer::StoredKeypoints(const std::string& database_name) {
  if (!source_) throw InputError("pair with " + database_name + ": without a database, its keypoints must be given");
  const DatabaseImage* image = source_->Selection().FindInDatabase(database_name);
  if (image == nullptr) throw InputError("pair with " + database_name + ": the database does not have this image");
  return DatabaseReader(source_->Database().Path()).ReadKeypoints(image->image_id);
}

LocalizationProblem Localizer::MakeProblem(const std::string& name, const Camera& camera,
                                           std::vector<Eigen::Vector2d> keypoints,
                                           const std::vector<GivenPair>& pairs) {
  CheckFinite(keypoints, name);
  LocalizationProblem problem;
  problem.query_name = name;
  problem.query_camera = camera;
  problem.query_keypoints = std::move(keypoints);
  for (const GivenPair& given : pairs) {
    const std::string owner = "pair with " + given.database_name;
    const ModelImage* image = FindByName(DatabaseModel().images, given.database_name);
    if (image == nullptr) throw InputError(owner + ": the model has no posed image of this name");
    ImagePair pair = MakeDatabasePair(*image, DatabaseModel(), DatabaseFrames());
    pair.other_keypoints = given.keypoints ? *given.keypoints : StoredKeypoints(given.database_name);
    CheckFinite(pair.other_keypoints, owner);
    CheckMatches(given.matches, problem.query_keypoints.size(), pair.other_keypoints.size(), owner);
    pair.matches = given.matches;
    std::sort(pair.matches.begin(), pair.matches.end());
    if (!pair.matches.empty()) problem.pairs.push_back(std::move(pair));
  }
  std::sort(problem.pairs.begin(), problem.pairs.end(),
            [](const ImagePair& a, const ImagePair& b) { return a.other_name < b.other_name; });
  return problem;
}

QueryPrior Localizer::MakePrior(const std::vector<double>& position, const std::vector<double>& gravity) const {
  QueryPrior prior;
  if (!position.empty()) prior.position = MakePositionPrior(position);
  if (!gravity.empty()) prior.gravity = MakeGravityPrior(gravity, options_.source.priors.world_up);
  return prior;
}

std::vector<QueryRecord> Localizer::Localize(size_t group, const std::string& name, const QueryPrior& prior) {
  GroupInput input = source_->Group(group);
  for (GroupInput::Frame& frame : input.frames) {
    for (GroupInput::Image& image : frame.images) {
      if (std::get<std::string>(image.query) == name) image.prior = prior;
    }
  }
  return Localize(input);
}

std::vector<QueryRecord> Localizer::Localize(const GroupInput& input) {
  Call call(this);
  LoadedGroup loaded;
  std::vector<LocalizationResult> results;
  LocalizerOptions options = options_.localizer;
  if (HasOnlyMatches(input)) {
    loaded =
        LoadEach(input, [](const QueryInput& query, QueryRecord*) { return std::get<LocalizationProblem>(query); });
    if (source_) source_->AddDatabasePairsAndDepths(call.Session(), &loaded);
    // Uses all pairs that a user gives, as colmap lazy_localizer does with a file of pairs.
    options.max_num_pairs = 0;
    results = LocalizeLoaded(loaded, options);
  } else {
    if (!source_) throw InputError("only queries with matches of their own can do without a database");
    options.max_num_pairs = source_->MaxNumPairs();
    results = LoadAndLocalize(*source_, input, options, call.Session(), &loaded);
  }
  for (size_t i = 0; i < results.size(); ++i) {
    loaded.records[i].keypoints = std::move(loaded.group.images[i].problem.query_keypoints);
  }
  return FinishRecords(std::move(loaded), std::move(results));
}

}  // namespace lazyloc
