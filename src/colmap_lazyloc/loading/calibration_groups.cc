#include "colmap_lazyloc/loading/calibration_groups.h"

#include <algorithm>
#include <string_view>
#include <utility>

namespace lazyloc {

std::optional<uint32_t> SharedCameraKey(const QuerySelection& selection, CameraSharing sharing,
                                        const std::string& query_name) {
  if (sharing == CameraSharing::ALL) return 0;
  if (sharing == CameraSharing::NONE || !selection.FindStoredQuery(query_name)) return std::nullopt;
  return selection.FindInDatabase(query_name)->camera_id;
}

std::map<uint32_t, std::vector<size_t>> CalibrationGroups(const QuerySelection& selection, CameraSharing sharing) {
  constexpr size_t kMaxNumGroups = 20;
  std::map<uint32_t, std::vector<std::pair<std::string_view, size_t>>> by_key;
  const QueryGroups& groups = selection.Groups();
  for (size_t i = 0; sharing != CameraSharing::NONE && i < groups.Size(); ++i) {
    if (!groups.IsSingle(i)) continue;
    const std::string_view name = groups.At(i).front().images.front().name;
    const std::optional<uint32_t> key = SharedCameraKey(selection, sharing, std::string(name));
    if (key) by_key[*key].emplace_back(name, i);
  }
  std::map<uint32_t, std::vector<size_t>> chosen;
  for (auto& [key, queries] : by_key) {
    if (queries.size() < 2) continue;
    std::sort(queries.begin(), queries.end());
    const size_t num_chosen = std::min(queries.size(), kMaxNumGroups);
    for (size_t i = 0; i < num_chosen; ++i) chosen[key].push_back(queries[i * queries.size() / num_chosen].second);
  }
  return chosen;
}

}  // namespace lazyloc
