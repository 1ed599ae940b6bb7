#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/io/query_files.h"
#include "colmap_lazyloc/io/query_groups.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct ProblemLoaderOptions {
  int num_retrieved = 20;             // database images per query
  bool leave_one_out = false;         // queries are posed images, each group against all others
  bool has_photos = false;            // queries without keypoints in the database are photos
  QueryGroupsOptions groups;
};

// A query whose features are not in the database.
struct PhotoQuery {
  std::string name;
  std::optional<Camera> camera;                           // where it is known beforehand
  std::optional<std::vector<std::string>> partner_names;  // of the pairs file, where there is one
};

// Decides what the queries and the database images are, and loads one query's problem at a time: memory does not grow
// with the database but for its images' names and poses.
class ProblemLoader {
 public:
  // queries: of the query list; empty for all (see the command's help). pairs_path: a pairs file; empty for the pairs
  // that the database has matches for. Throws InputError for a query that the database does not hold, an unusable
  // camera, or what ReadPairs refuses.
  ProblemLoader(const DatabaseReader& database, Model model, const std::vector<QueryListEntry>& queries,
                const std::filesystem::path& pairs_path, const ProblemLoaderOptions& options);

  // Sorted by name.
  const std::vector<std::string>& QueryNames() const { return query_names_; }
  // Those of the queries that are photos, by name: Load is not for them.
  const std::map<std::string, PhotoQuery>& Photos() const { return photos_; }
  // The posed images without those that are queries (with leave_one_out: all).
  const Model& DatabaseModel() const { return model_; }
  // The queries, grouped.
  const std::vector<QueryFrames>& Groups() const { return groups_; }
  // One line each, on what was left out of the pairs file or has no place in a rig.
  const std::vector<std::string>& Warnings() const { return warnings_; }

  // The pairs file's pairs, or the best num_retrieved by verified inliers; where the database has fewer than these,
  // also as many with only raw matches, best by their number, from which the localizer chooses when they are verified.
  // Throws InputError for damaged data. Thread-safe, with a reader per thread.
  LocalizationProblem Load(const std::string& query_name, const DatabaseReader& database) const;
  // Adds what a group has besides its members: the pairs among its queries (those that are not photos), all that the
  // database has matches for, or of these the pairs file's.
  void LoadQueryPairs(const DatabaseReader& database, QueryGroup* group) const;

 private:
  struct StoredImage {
    DatabaseImage image;
    Camera camera;
    Camera stored_camera;  // the one that the database's geometries were estimated with
  };
  struct Query : StoredImage {
    size_t group = 0;
  };
  struct Candidate {
    const ModelImage* image = nullptr;
    uint32_t image_id = 0;  // in the database
    int num_matches = 0;    // verified or raw
  };
  using Candidates = std::vector<Candidate>;

  void ChooseQueries(const std::vector<QueryListEntry>& queries, const DatabaseReader& database);
  void ChooseGroups(const DatabaseReader& database);
  // posed: the image in the model, or null.
  void AddQuery(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database);
  bool IsPhoto(const std::string& name, const DatabaseReader& database) const;
  // The posed images among `sizes`, most matches first.
  Candidates RankCandidates(const Query& query, const std::vector<PairSize>& sizes) const;
  Candidates ListedCandidates(const Query& query) const;
  // Adds pairs with the candidates to the problem until it has max_num_pairs.
  void LoadPairs(const Query& query, const Candidates& candidates, size_t max_num_pairs, const DatabaseReader& database,
                 LocalizationProblem* problem) const;
  void LoadBestPairs(const Query& query, const DatabaseReader& database, LocalizationProblem* problem) const;
  // Without the other image's pose. None where there are no matches, or verification left none.
  std::optional<ImagePair> LoadPair(const Query& query, const StoredImage& other, const DatabaseReader& database) const;

  Model model_;
  std::map<std::string, std::vector<std::string>> pairs_;
  bool has_pairs_file_ = false;
  std::vector<std::string> warnings_;
  ProblemLoaderOptions options_;
  std::unordered_map<std::string, DatabaseImage> database_images_;  // by name
  std::unordered_map<uint32_t, const ModelImage*> posed_of_database_id_;
  std::unordered_map<std::string, Query> queries_;
  std::map<std::string, PhotoQuery> photos_;
  std::vector<std::string> query_names_;
  std::vector<QueryFrames> groups_;
};

}  // namespace lazyloc
