#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct QueryGroupsOptions {
  std::filesystem::path rig_config_path, group_list_path, trajectory_path;
  bool use_rigs = true;
  bool trajectory_has_scale = true;  // its lengths are in the database's unit
  int group_size = 1;                // frames
};

// Queries that move as one rigid body. A lone query has no frame name and the identity.
struct QueryFrame {
  struct Image {
    std::string name;
    Rigid3d cam_from_rig;
  };
  std::string name;
  std::vector<Image> images;
};

// Frames that are localized together.
using QueryFrames = std::vector<QueryFrame>;

struct QueryGroups {
  std::vector<QueryFrames> groups;  // each query in one of them
  std::string warning;  // one line on queries without a place in a rig or trajectory; empty where there is none
};

// Groups the queries, in their given order:
// - into frames by the rig configuration, else by the rigs of the model, for queries that it has too, or of the
// database
//   (unless use_rigs is false);
// - of these, one group per line of the group list (names of images; what is not listed stays alone), else runs of
//   group_size frames;
// - with a trajectory each group is one frame instead, all queries one where neither list nor size is given.
// Forms of the files: io/rig_config.h, io/trajectory.h.
// Throws InputError naming the file, for what is damaged, contradictory or fits no query.
QueryGroups GroupQueries(const std::vector<std::string>& query_names, const DatabaseReader& database,
                         const Model& model, const QueryGroupsOptions& options);

}  // namespace lazyloc
