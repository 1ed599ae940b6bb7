#pragma once

#include <sys/types.h>

#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Matches with a database image, as a user gives them.
struct GivenPair {
  std::string database_name;
  std::optional<std::vector<Eigen::Vector2d>> keypoints;  // xy in pixels; nullopt: those in the database
  Matches matches;
};

// Localizes queries one group at a time with the objects of colmap lazy_localizer. The index, features and caches stay
// loaded between calls. Thread-safe, also after a fork, because each process opens the database anew.
class Localizer {
 public:
  // model: instead of the one at input_path. Without database_path, only queries with features and matches of their own
  // can be localized. Throws InputError for files that cannot be used.
  Localizer(const CommandOptions& options, std::optional<Model> model);

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
  class Call;

  const Model& DatabaseModel() const { return source_ ? source_->DatabaseModel() : model_; }
  const FramePlaces& DatabaseFrames() const { return source_ ? source_->Selection().DatabaseFrames() : frames_; }
  std::vector<Eigen::Vector2d> StoredKeypoints(const std::string& database_name);

  CommandOptions options_;
  std::unique_ptr<QuerySource> source_;  // null without a database
  Model model_;                          // without a database
  FramePlaces frames_;                   // without a database
  IdleThreads idle_threads_;             // threads that no call uses
  std::mutex sessions_mutex_;
  std::vector<std::unique_ptr<QuerySource::Session>> sessions_;  // that no call uses
  std::set<std::string> told_depth_problems_;
  pid_t process_;  // that has made the sessions
};

}  // namespace lazyloc
