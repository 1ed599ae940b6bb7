#include "colmap_lazyloc/queries/query_groups.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/trajectory.h"
#include "colmap_lazyloc/queries/rig_frames.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// Returns the frames in the order of their first queries.
QueryFrames MakeFrames(const std::vector<std::string_view>& query_names, const FramePlaces& places) {
  QueryFrames frames;
  std::unordered_map<std::string, size_t> frame_of_name;
  for (const std::string_view name : query_names) {
    const auto place = places.find(std::string(name));
    if (place == places.end()) {
      frames.push_back({"", {{name, {}}}});
      continue;
    }
    const auto [frame, is_new] = frame_of_name.emplace(place->second.frame_name, frames.size());
    if (is_new) frames.push_back({place->second.frame_name, {}});
    frames[frame->second].images.push_back({name, place->second.cam_from_rig});
  }
  for (QueryFrame& frame : frames) {
    std::sort(frame.images.begin(), frame.images.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    if (frame.images.size() == 1) frame.name.clear();
  }
  return frames;
}

std::vector<QueryFrames> GroupByList(const QueryFrames& frames, const std::filesystem::path& path) {
  std::unordered_map<std::string_view, size_t> frame_of_name;
  for (size_t i = 0; i < frames.size(); ++i) {
    for (const QueryFrame::Image& image : frames[i].images) frame_of_name.emplace(image.name, i);
  }
  std::vector<QueryFrames> groups;
  std::vector<int> group_of_frame(frames.size(), -1);
  std::set<std::string> listed;
  TextFile file(path);
  while (file.NextEntry()) {
    const int group = static_cast<int>(groups.size());
    groups.emplace_back();
    std::string_view rest = file.Line();
    for (std::string name(NextWord(&rest)); !name.empty(); name = NextWord(&rest)) {
      const auto frame = frame_of_name.find(name);
      if (frame == frame_of_name.end()) throw file.Error("'" + name + "' is not a query");
      if (!listed.insert(name).second) throw file.Error("'" + name + "' is listed twice");
      int& group_of = group_of_frame[frame->second];
      if (group_of >= 0 && group_of != group) {
        throw file.Error("the frame of '" + name + "' is already in another group");
      }
      if (group_of < 0) groups.back().push_back(frames[frame->second]);
      group_of = group;
    }
  }
  if (groups.empty()) throw InputError(path.string() + ": contains no group");
  for (size_t i = 0; i < frames.size(); ++i) {
    if (group_of_frame[i] < 0) groups.push_back({frames[i]});
  }
  return groups;
}

// Makes each group one frame, whose images have their places on the trajectory.
std::vector<QueryFrames> JoinByTrajectory(const std::vector<QueryFrames>& groups,
                                          const std::map<std::string, Rigid3d>& trajectory) {
  std::vector<QueryFrames> joined;
  for (const QueryFrames& group : groups) {
    QueryFrame whole;
    for (const QueryFrame& frame : group) {
      for (const QueryFrame::Image& image : frame.images) {
        whole.images.push_back({image.name, trajectory.at(std::string(image.name))});
      }
    }
    whole.name = whole.images.front().name;
    joined.push_back({std::move(whole)});
  }
  return joined;
}

template <typename Name>
std::string CountWithExample(const std::vector<Name>& names) {
  const std::string example(names.front());
  if (names.size() == 1) return "1 query (" + example + ")";
  return std::to_string(names.size()) + " queries (for example " + example + ")";
}

std::string ItOrThem(size_t number) { return number == 1 ? "it" : "them"; }

FramePlaces FindFrames(const std::vector<std::string_view>& names, const DatabaseReader* database, const Model& model,
                       const QueryGroupsOptions& options, FrameProblems* problems) {
  if (!options.use_rigs) return {};
  if (!options.rig_config_path.empty()) return FramesFromConfig(names, options.rig_config_path);
  return FramesFromColmap(names, database, model, problems);
}

std::vector<QueryFrames> GroupFrames(const QueryFrames& frames, const QueryGroupsOptions& options, size_t group_size) {
  if (!options.group_list_path.empty()) return GroupByList(frames, options.group_list_path);
  std::vector<QueryFrames> groups;
  for (const QueryFrame& frame : frames) {
    if (groups.empty() || groups.back().size() == group_size) groups.emplace_back();
    groups.back().push_back(frame);
  }
  return groups;
}

void AddEach(std::vector<QueryFrames> groups, QueryGroups* result) {
  for (QueryFrames& group : groups) result->Add(std::move(group));
}

QueryGroups GroupByTrajectory(const std::vector<std::string_view>& query_names, const QueryGroupsOptions& options) {
  const std::map<std::string, Rigid3d> trajectory =
      ReadTrajectory(options.trajectory_path, {query_names.begin(), query_names.end()});
  std::vector<std::string_view> on_trajectory, elsewhere;
  for (const std::string_view name : query_names) {
    (trajectory.count(std::string(name)) > 0 ? on_trajectory : elsewhere).push_back(name);
  }
  const std::string& path = options.trajectory_path;
  if (on_trajectory.empty()) {
    throw InputError(path + ": no pose for any query (for example " + std::string(query_names.front()) + ")");
  }
  const QueryFrames frames = MakeFrames(on_trajectory, {});
  const size_t group_size = options.group_size > 1 ? options.group_size : frames.size();
  QueryGroups result;
  result.has_rig_scale = options.trajectory_has_scale;
  AddEach(JoinByTrajectory(GroupFrames(frames, options, group_size), trajectory), &result);
  for (const std::string_view name : elsewhere) result.AddSingle(name);
  if (!elsewhere.empty()) {
    result.warnings.push_back(path + ": no pose for " + CountWithExample(elsewhere) + ": localizing " +
                              ItOrThem(elsewhere.size()) + " individually");
  }
  return result;
}

}  // namespace

bool QueryGroupsOptions::Check(std::string* error) const {
  OPTION_GE(group_size, 1);
  return true;
}

QueryFrames QueryGroups::At(size_t group) const {
  const std::string_view single_query = single_queries_[group];
  return single_query.empty() ? other_groups_.at(group) : QueryFrames{{"", {{single_query, {}}}}};
}

void QueryGroups::Add(QueryFrames frames) {
  other_groups_.emplace(Size(), std::move(frames));
  single_queries_.emplace_back();
}

QueryGroups GroupQueries(const std::vector<std::string_view>& query_names, const DatabaseReader& database,
                         const Model& model, const QueryGroupsOptions& options) {
  if (!options.trajectory_path.empty()) return GroupByTrajectory(query_names, options);
  FrameProblems problems;
  const FramePlaces places = FindFrames(query_names, &database, model, options, &problems);
  if (options.use_rigs && !options.rig_config_path.empty() && places.empty()) {
    throw InputError(options.rig_config_path + ": no query matches the image_prefix of a camera");
  }
  QueryGroups result;
  if (places.empty() && options.group_list_path.empty() && options.group_size == 1) {
    for (const std::string_view name : query_names) result.AddSingle(name);
  } else {
    AddEach(GroupFrames(MakeFrames(query_names, places), options, options.group_size), &result);
  }
  const std::string path = database.Path().string();
  if (const auto& names = problems.images_without_pose; !names.empty()) {
    result.warnings.push_back(path + ": no pose in the rig for the cameras of " + CountWithExample(names) +
                              ": localizing " + ItOrThem(names.size()) + " without the rig");
  }
  for (const std::string& damage : problems.damages) {
    result.warnings.push_back(path + ": " + damage + ": localizing the image without the rig");
  }
  return result;
}

FramePlaces DatabaseFramePlaces(const Model& model, const DatabaseReader* database, const QueryGroupsOptions& options) {
  std::vector<std::string_view> image_names;
  for (const ModelImage& image : model.images) image_names.push_back(image.name);
  FrameProblems ignored;  // GroupQueries reports them
  return SharedFrames(FindFrames(image_names, database, model, options, &ignored));
}

}  // namespace lazyloc
