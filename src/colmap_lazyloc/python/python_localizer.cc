#include "colmap_lazyloc/python/python_localizer.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/formats/model_reader.h"
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

// Reads the model, unless it is given.
Model ModelOf(const CommandOptions& options, std::optional<Model> model) {
  return model ? *std::move(model) : ReadModel(options.source.input_path);
}

SourceOptions WithMoreQueries(SourceOptions source) {
  source.selection.has_more_queries = true;
  return source;
}

}  // namespace

PythonLocalizer::PythonLocalizer(const CommandOptions& options, std::optional<Model> model)
    : priors_(options.source.priors),
      idle_threads_(EffectiveNumThreads(options.num_threads)),
      localizer_(WithMoreQueries(options.source), options.localizer, ModelOf(options, std::move(model)),
                 options.num_threads, &idle_threads_),
      frames_(localizer_.Source() ? FramePlaces()
                                  : DatabaseFramePlaces(DatabaseModel(), nullptr, options.source.selection.groups)) {}

std::vector<std::string> PythonLocalizer::Warnings() const {
  return localizer_.Source() ? localizer_.Source()->Warnings() : std::vector<std::string>();
}

std::vector<std::string> PythonLocalizer::TakeDepthProblems() {
  std::vector<std::string> untold;
  if (!localizer_.Source() || localizer_.Source()->Depths() == nullptr) return untold;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const std::string& problem : localizer_.Source()->Depths()->Problems()) {
    if (told_depth_problems_.insert(problem).second) untold.push_back(problem);
  }
  return untold;
}

std::vector<std::vector<std::string>> PythonLocalizer::Groups() const {
  std::vector<std::vector<std::string>> groups;
  if (!localizer_.Source()) return groups;
  for (size_t i = 0; i < localizer_.Source()->NumGroups(); ++i) {
    groups.emplace_back();
    for (const QueryFrame& frame : localizer_.Source()->Selection().Groups().At(i)) {
      for (const QueryFrame::Image& image : frame.images) groups.back().emplace_back(image.name);
    }
  }
  return groups;
}

size_t PythonLocalizer::FindGroup(const std::string& query_name) const {
  if (!localizer_.Source()) throw InputError("query " + query_name + " needs a database, but the Localizer has none");
  if (const std::optional<size_t> group = localizer_.Source()->Selection().FindGroup(query_name)) return *group;
  if (FindByName(DatabaseModel().images, query_name) != nullptr) {
    throw InputError("query " + query_name + " has a pose in the model (see LazyLocalizer.leave_one_out)");
  }
  if (localizer_.Source()->Selection().FindInDatabase(query_name) != nullptr) {
    throw InputError("query " + query_name + " is not in the list of queries");
  }
  throw InputError("query " + query_name + " is not in the database " +
                   localizer_.Source()->Database().Path().string());
}

std::vector<Eigen::Vector2d> PythonLocalizer::StoredKeypoints(const std::string& database_name) {
  if (!localizer_.Source())
    throw InputError("pair with " + database_name + ": without a database, its keypoints must be given");
  const DatabaseImage* image = localizer_.Source()->Selection().FindInDatabase(database_name);
  if (image == nullptr) throw InputError("pair with " + database_name + ": the database does not have this image");
  return DatabaseReader(localizer_.Source()->Database().Path()).ReadKeypoints(image->image_id);
}

LocalizationProblem PythonLocalizer::MakeProblem(const std::string& name, const Camera& camera,
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

QueryPrior PythonLocalizer::MakePrior(const std::vector<double>& position, const std::vector<double>& gravity) const {
  QueryPrior prior;
  if (!position.empty()) prior.position = MakePositionPrior(position);
  if (!gravity.empty()) prior.gravity = MakeGravityPrior(gravity, priors_.world_up);
  return prior;
}

std::vector<QueryRecord> PythonLocalizer::Localize(size_t group, const std::string& name, const QueryPrior& prior) {
  GroupInput input = localizer_.Source()->Group(group);
  for (GroupInput::Frame& frame : input.frames) {
    for (GroupInput::Image& image : frame.images) {
      if (std::get<std::string>(image.query) == name) image.prior = prior;
    }
  }
  return Localize(input);
}

std::vector<QueryRecord> PythonLocalizer::Localize(const GroupInput& input) {
  const BusyThread busy(&idle_threads_);
  return localizer_.Localize(input, /*with_keypoints=*/true);
}

}  // namespace lazyloc
