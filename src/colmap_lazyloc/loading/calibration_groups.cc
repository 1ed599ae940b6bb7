#include "colmap_lazyloc/loading/calibration_groups.h"

#include <algorithm>

#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {

std::optional<uint32_t> SharedCameraKey(const QuerySelection& selection, CameraSharing sharing,
                                        const std::string& query_name) {
  if (sharing == CameraSharing::ALL) return 0;
  if (sharing == CameraSharing::NONE || !selection.FindStoredQuery(query_name)) return std::nullopt;
  return selection.FindInDatabase(query_name)->camera_id;
}

std::vector<size_t> ChooseSpread(const std::vector<std::string>& sorted_names, size_t max_num) {
  const size_t num = sorted_names.size(), num_chosen = std::min(num, max_num);
  std::vector<size_t> chosen;
  for (size_t i = 0; i < num_chosen; ++i) {
    const size_t begin = i * num / num_chosen, end = (i + 1) * num / num_chosen;
    chosen.push_back(begin + SeedFromNames(sorted_names[begin], "", 0) % (end - begin));
  }
  return chosen;
}

std::map<uint32_t, std::vector<size_t>> CalibrationGroups(const QuerySelection& selection, CameraSharing sharing) {
  constexpr size_t kMaxNumGroups = 20;
  std::map<uint32_t, std::map<std::string, size_t>> by_key;  // index of the group, by name
  const QueryGroups& groups = selection.Groups();
  for (size_t i = 0; sharing != CameraSharing::NONE && i < groups.Size(); ++i) {
    if (!groups.IsSingle(i)) continue;
    const std::string name(groups.At(i).front().images.front().name);
    const std::optional<uint32_t> key = SharedCameraKey(selection, sharing, name);
    if (key) by_key[*key].emplace(name, i);
  }
  std::map<uint32_t, std::vector<size_t>> chosen;
  for (const auto& [key, group_of_name] : by_key) {
    if (group_of_name.size() < 2) continue;
    std::vector<std::string> names;
    for (const auto& name_and_group : group_of_name) names.push_back(name_and_group.first);
    for (const size_t i : ChooseSpread(names, kMaxNumGroups)) chosen[key].push_back(group_of_name.at(names[i]));
  }
  return chosen;
}

}  // namespace lazyloc
