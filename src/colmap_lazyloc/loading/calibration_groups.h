#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// Which queries were taken by one camera, as far as the user has said so.
enum class CameraSharing {
  NONE,      // each by its own
  DATABASE,  // queries whose keypoints are in the database: those of one camera there
  ALL,       // queries of the same size
};

// Returns the key of the camera that a single query shares with others of the same key: the id of its camera in the
// database, or 0 with CameraSharing::ALL; nullopt if it shares none.
std::optional<uint32_t> SharedCameraKey(const QuerySelection& selection, CameraSharing sharing,
                                        const std::string& query_name);

// Returns the indices of at most max_num names: one of each of as many parts of the list, by its hash. Even steps could
// meet only one of two cameras that took photos in turn.
std::vector<size_t> ChooseSpread(const std::vector<std::string>& sorted_names, size_t max_num);

// Returns by key the groups whose queries a camera is estimated from: at most 20 groups of one query (ChooseSpread).
// Leaves out cameras of a single query.
std::map<uint32_t, std::vector<size_t>> CalibrationGroups(const QuerySelection& selection, CameraSharing sharing);

}  // namespace lazyloc
