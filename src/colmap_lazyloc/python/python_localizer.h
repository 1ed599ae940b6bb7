#pragma once

#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "colmap_lazyloc/localizer/localizer.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/options/options.h"

namespace lazyloc {

// Matches with a database image, as a user gives them.
struct GivenPair {
  std::string database_name;
  std::optional<std::vector<Eigen::Vector2d>> keypoints;  // xy in pixels; nullopt: those in the database
  Matches matches;
};

// A Localizer as Python uses it: with queries that a caller makes, and problems that are told once. Thread-safe.
class PythonLocalizer {
 public:
  // model: instead of the one at input_path. Throws like Localizer.
  PythonLocalizer(const CommandOptions& options, std::optional<Model> model);

  const WorldAxes& Axes() const { return DatabaseModel().axes; }
  // Returns one line for each problem of the files that is not an error.
  std::vector<std::string> Warnings() const;
  // Returns one line for each depth map that could not be used since the last call.
  std::vector<std::string> TakeDepthProblems();
  // Returns the names of the queries that the options select, in their groups.
  std::vector<std::vector<std::string>> Groups() const;
  // Returns the index of a query's group. Throws InputError if there is no query of this name.
  size_t FindGroup(const std::string& query_name) const;

  // Makes a query from features and matches. Throws InputError for an image or a keypoint that does not exist.
  LocalizationProblem MakeProblem(const std::string& name, const Camera& camera, std::vector<Eigen::Vector2d> keypoints,
                                  const std::vector<GivenPair>& pairs);
  // Makes a prior of numbers as in the lines of the files (query_prior_files.h); none of empty ones. Throws InputError
  // for impossible numbers.
  QueryPrior MakePrior(const std::vector<double>& position, const std::vector<double>& gravity) const;
  // Localize one group and return a record per query, with the keypoints of each. Throw InputError for a damaged file.
  // prior: of the query of this name, in place of the one in files.
  std::vector<QueryRecord> Localize(size_t group, const std::string& name, const QueryPrior& prior);
  std::vector<QueryRecord> Localize(const GroupInput& input);

 private:
  const Model& DatabaseModel() const { return localizer_.DatabaseModel(); }
  const FramePlaces& DatabaseFrames() const {
    return localizer_.Source() ? localizer_.Source()->Selection().DatabaseFrames() : frames_;
  }
  std::vector<Eigen::Vector2d> StoredKeypoints(const std::string& database_name);

  const QueryPriorOptions priors_;
  IdleThreads idle_threads_;  // threads that no call uses
  const Localizer localizer_;
  const FramePlaces frames_;  // without a database
  std::mutex mutex_;
  std::set<std::string> told_depth_problems_;
};

}  // namespace lazyloc
