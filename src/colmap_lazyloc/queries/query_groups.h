#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/queries/rig_frames.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct QueryGroupsOptions {
  std::string rig_config_path, group_list_path, trajectory_path;
  bool use_rigs = true;
  bool trajectory_has_scale = true;  // true if its lengths are in database units
  int group_size = 1;                // frames

  bool Check(std::string* error) const;
};

// Queries that move as one rigid body. A single query has an empty frame name; cam_from_rig is its camera's place in
// the rig, the identity if it has none.
struct QueryFrame {
  struct Image {
    std::string_view name;
    Rigid3d cam_from_rig;
  };
  std::string name;
  std::vector<Image> images;
};

// Frames that are localized together.
using QueryFrames = std::vector<QueryFrame>;

// Groups of queries, each of which is in one of them. Refers to the names that it was made from. A group of one query
// takes only a few bytes, because there may be millions.
class QueryGroups {
 public:
  size_t Size() const { return single_queries_.size(); }
  QueryFrames At(size_t group) const;
  // Returns true for a group of one query without a place in a rig.
  bool IsSingle(size_t group) const { return !single_queries_[group].empty(); }
  void Add(QueryFrames frames);
  // Adds a query that has no place in a rig.
  void AddSingle(std::string_view query_name) { single_queries_.push_back(query_name); }

  bool has_rig_scale = true;  // false if the unit of cam_from_rig is unknown
  // One line for each problem that leaves queries without a place in a rig or trajectory.
  std::vector<std::string> warnings;

 private:
  std::vector<std::string_view> single_queries_;  // by group; empty if the group is in other_groups_
  std::unordered_map<size_t, QueryFrames> other_groups_;
};

// Groups the queries in three steps, in their given order:
// 1. Frames: by the rig configuration, else by the rigs of the model (if it has the queries) or the database. Without
//    use_rigs each query is a frame.
// 2. Groups: one for each line of the group list (image names; the frame of an image that is not listed is a group of
//    its own), else runs of group_size frames.
// 3. With a trajectory, step 1 is left out and each group becomes one frame. Without list and size, all queries are one
//    frame.
// The formats are in formats/rig_config.h and formats/trajectory.h. The names must outlive the groups. Throws
// InputError naming the file if it is damaged, contradicts itself or fits no query.
QueryGroups GroupQueries(const std::vector<std::string_view>& query_names, const DatabaseReader& database,
                         const Model& model, const QueryGroupsOptions& options);

// Returns the rig frames (as in step 1) that hold two or more of the model's images. database: null if there is none.
FramePlaces DatabaseFramePlaces(const Model& model, const DatabaseReader* database, const QueryGroupsOptions& options);

}  // namespace lazyloc
