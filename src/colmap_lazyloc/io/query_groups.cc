#include "colmap_lazyloc/io/query_groups.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "colmap_lazyloc/io/rig_config.h"
#include "colmap_lazyloc/io/text_file.h"
#include "colmap_lazyloc/io/trajectory.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// A query's place in a rig's frame.
struct Place {
  std::string frame_name;
  Rigid3d cam_from_rig;
};
using Places = std::unordered_map<std::string, Place>;  // by query

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

Places PlacesFromConfig(const std::vector<std::string>& query_names, const std::filesystem::path& path) {
  const std::vector<RigCameras> rigs = ReadRigConfig(path);
  Places places;
  for (const std::string& name : query_names) {
    for (size_t rig = 0; rig < rigs.size(); ++rig) {
      for (const RigCamera& camera : rigs[rig]) {
        if (!StartsWith(name, camera.image_prefix)) continue;
        const std::string frame =
            (rigs.size() > 1 ? "rig " + std::to_string(rig + 1) + ": " : "") + name.substr(camera.image_prefix.size());
        if (!places.emplace(name, Place{frame, camera.cam_from_rig}).second) {
          throw InputError(path.string() + ": image " + name + " is of two cameras");
        }
      }
    }
  }
  if (places.empty()) throw InputError(path.string() + ": no query has a camera's image_prefix");
  return places;
}

// images_without_pose: those of cameras whose place in their rig is not known.
Places PlacesFromDatabase(const std::vector<std::string>& query_names, const DatabaseReader& database,
                          std::vector<std::string>* images_without_pose) {
  const std::vector<DatabaseRigImage> rig_images = database.ReadRigImages();
  if (rig_images.empty()) return {};
  const std::unordered_set<std::string> queries(query_names.begin(), query_names.end());
  std::unordered_map<uint32_t, std::string> name_of_id;
  for (const DatabaseImage& image : database.ReadImages()) {
    if (queries.count(image.name) > 0) name_of_id.emplace(image.image_id, image.name);
  }
  Places places;
  for (const DatabaseRigImage& image : rig_images) {
    const auto name = name_of_id.find(image.image_id);
    if (name == name_of_id.end()) continue;
    if (image.cam_from_rig) {
      places[name->second] = {std::to_string(image.frame_id), *image.cam_from_rig};
    } else {
      images_without_pose->push_back(name->second);
    }
  }
  return places;
}

// In order of their first queries.
QueryFrames MakeFrames(const std::vector<std::string>& query_names, const Places& places) {
  QueryFrames frames;
  std::unordered_map<std::string, size_t> frame_of_name;
  for (const std::string& name : query_names) {
    const auto place = places.find(name);
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
    if (frame.images.size() == 1) frame = {"", {{frame.images.front().name, {}}}};
  }
  return frames;
}

std::vector<QueryFrames> GroupByList(const QueryFrames& frames, const std::filesystem::path& path) {
  std::unordered_map<std::string, size_t> frame_of_name;
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
      if (frame == frame_of_name.end()) throw file.Error("'" + name + "' is no query");
      if (!listed.insert(name).second) throw file.Error("'" + name + "' is listed twice");
      int& group_of = group_of_frame[frame->second];
      if (group_of >= 0 && group_of != group) throw file.Error("the rig of '" + name + "' is in another group already");
      if (group_of < 0) groups.back().push_back(frames[frame->second]);
      group_of = group;
    }
  }
  if (groups.empty()) throw InputError(path.string() + ": lists no group");
  for (size_t i = 0; i < frames.size(); ++i) {
    if (group_of_frame[i] < 0) groups.push_back({frames[i]});
  }
  return groups;
}

std::vector<QueryFrames> GroupBySize(const QueryFrames& frames, size_t group_size) {
  std::vector<QueryFrames> groups;
  for (const QueryFrame& frame : frames) {
    if (groups.empty() || groups.back().size() == group_size) groups.emplace_back();
    groups.back().push_back(frame);
  }
  return groups;
}

// Makes each group one frame of the trajectory.
std::vector<QueryFrames> JoinByTrajectory(const std::vector<QueryFrames>& groups,
                                          const std::map<std::string, Rigid3d>& trajectory) {
  std::vector<QueryFrames> joined;
  for (const QueryFrames& group : groups) {
    QueryFrame whole;
    for (const QueryFrame& frame : group) {
      for (const QueryFrame::Image& image : frame.images) {
        whole.images.push_back({image.name, trajectory.at(image.name)});
      }
    }
    whole.name = whole.images.front().name;
    joined.push_back({whole});
  }
  return joined;
}

std::string SuchAs(const std::vector<std::string>& names) {
  return std::to_string(names.size()) + " queries, such as " + names.front();
}

QueryGroups GroupByTrajectory(const std::vector<std::string>& query_names, const QueryGroupsOptions& options) {
  const std::map<std::string, Rigid3d> trajectory = ReadTrajectory(options.trajectory_path, query_names);
  std::vector<std::string> on_trajectory, elsewhere;
  for (const std::string& name : query_names) (trajectory.count(name) > 0 ? on_trajectory : elsewhere).push_back(name);
  const std::string path = options.trajectory_path.string();
  if (on_trajectory.empty()) throw InputError(path + ": has a pose of no query, such as " + query_names.front());
  const QueryFrames frames = MakeFrames(on_trajectory, {});
  QueryGroups result;
  if (!options.group_list_path.empty()) {
    result.groups = GroupByList(frames, options.group_list_path);
  } else {
    result.groups = GroupBySize(frames, options.group_size > 1 ? options.group_size : frames.size());
  }
  result.groups = JoinByTrajectory(result.groups, trajectory);
  for (const QueryFrame& frame : MakeFrames(elsewhere, {})) result.groups.push_back({frame});
  if (!elsewhere.empty()) {
    result.warning = path + ": has no pose, so that they are localized each for itself, of " + SuchAs(elsewhere);
  }
  return result;
}

}  // namespace

QueryGroups GroupQueries(const std::vector<std::string>& query_names, const DatabaseReader& database,
                         const QueryGroupsOptions& options) {
  if (!options.trajectory_path.empty()) return GroupByTrajectory(query_names, options);
  QueryGroups result;
  Places places;
  std::vector<std::string> images_without_pose;
  if (options.use_rigs && !options.rig_config_path.empty()) {
    places = PlacesFromConfig(query_names, options.rig_config_path);
  } else if (options.use_rigs) {
    places = PlacesFromDatabase(query_names, database, &images_without_pose);
  }
  const QueryFrames frames = MakeFrames(query_names, places);
  result.groups = options.group_list_path.empty() ? GroupBySize(frames, options.group_size)
                                                  : GroupByList(frames, options.group_list_path);
  if (!images_without_pose.empty()) {
    result.warning = database.Path().string() + ": the rig has no pose of the camera of " + SuchAs(images_without_pose);
  }
  return result;
}

}  // namespace lazyloc
