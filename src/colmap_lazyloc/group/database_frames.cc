#include "colmap_lazyloc/group/database_frames.h"

#include <algorithm>
#include <optional>
#include <tuple>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Poses of one calibration differ by their rounding in files only.
constexpr double kMaxRoundingRad = 2e-5, kMaxRoundingRatio = 1e-4;

bool IsSame(const Rigid3d& a, const Rigid3d& b) {
  const Eigen::Vector3d centre = CamInWorld(a);
  return AngularDistanceRad(a.rotation, b.rotation) <= kMaxRoundingRad &&
         (CamInWorld(b) - centre).norm() <= kMaxRoundingRatio * centre.norm() + 1e-12;
}

std::optional<int> FindCalibration(const Rigid3d& cam_from_frame, const std::vector<Calibration>& calibrations) {
  for (size_t i = 0; i < calibrations.size(); ++i) {
    if (IsSame(cam_from_frame, calibrations[i].cam_from_frame)) return static_cast<int>(i);
  }
  return std::nullopt;
}

}  // namespace

int FindOrAddCalibration(const Rigid3d& cam_from_frame, std::vector<Calibration>* calibrations) {
  if (const std::optional<int> found = FindCalibration(cam_from_frame, *calibrations)) return *found;
  calibrations->emplace_back().cam_from_frame = cam_from_frame;
  return static_cast<int>(calibrations->size()) - 1;
}

int DatabaseFrames::AddImage(int query_frame, const ImagePair& pair) {
  const int next = static_cast<int>(layout_.given.images.size());
  const auto [image, is_new] = image_of_name_.emplace(std::pair(query_frame, pair.other_name), next);
  if (!is_new) return image->second;
  Rigid3d cam_from_world = pair.database_cam_from_world;
  cam_from_world.rotation.normalize();
  cam_from_world.translation += cam_from_world.rotation * layout_.origin;
  layout_.given.images.emplace_back();
  layout_.names.push_back(pair.other_name);
  // The prefix keeps a single image apart from a frame of the same name.
  const std::string key =
      pair.database_frame_name.empty() ? "image " + pair.other_name : "frame " + pair.database_frame_name;
  members_of_frame_[{query_frame, key}].push_back({next, cam_from_world, pair.database_cam_from_rig, {}});
  return next;
}

void DatabaseFrames::MakeFrames() {
  for (auto& [key, members] : members_of_frame_) PlaceMembers(key.first, &members);
  layout_.given.calibrations = StatedCalibrations();
  for (const auto& [key, members] : members_of_frame_) MakeFrame(key.first, members);
}

// Puts the camera of the frame's first query first: its images keep the database's poses, and a wrong calibration is
// corrected in the other cameras. Sets the members' places in the frame.
void DatabaseFrames::PlaceMembers(int query_frame, Members* members) const {
  const Rigid3d& own = group_.images[layout_.QueriesOf(query_frame).front()].cam_from_rig;
  const auto order = [&](const Member& member) {
    return std::tuple(!IsSame(member.cam_from_rig, own), layout_.names[member.image]);
  };
  std::sort(members->begin(), members->end(), [&](const Member& a, const Member& b) { return order(a) < order(b); });
  const Rigid3d world_from_frame = Inverse(members->front().cam_from_world);
  for (Member& member : *members) member.cam_from_frame = member.cam_from_world * world_from_frame;
}

// Returns the calibrations of the queries, and those that two or more rig frames of the database have.
std::vector<Calibration> DatabaseFrames::StatedCalibrations() const {
  std::vector<Calibration> calibrations = layout_.given.calibrations;
  std::vector<int> num_frames(calibrations.size(), 2);
  for (const auto& [key, members] : members_of_frame_) {
    for (size_t i = 1; i < members.size(); ++i) {
      const int calibration = FindOrAddCalibration(members[i].cam_from_frame, &calibrations);
      num_frames.resize(calibrations.size(), 0);
      ++num_frames[calibration];
    }
  }
  std::vector<Calibration> stated;
  for (size_t i = 0; i < calibrations.size(); ++i) {
    if (num_frames[i] > 1) stated.push_back(calibrations[i]);
  }
  return stated;
}

void DatabaseFrames::MakeFrame(int query_frame, const Members& members) {
  int first = 0;
  for (size_t i = 0; i < members.size(); ++i) {
    Image& image = layout_.given.images[members[i].image];
    const std::optional<int> calibration = FindCalibration(members[i].cam_from_frame, layout_.given.calibrations);
    if (i > 0 && calibration) {
      image.frame = first;
      image.calibration = *calibration;
      image.cam_from_frame = members[i].cam_from_frame;
      layout_.given.calibrations[image.calibration].is_stated_by_database = true;
      continue;
    }
    image.frame = static_cast<int>(layout_.given.frames.size());
    if (i == 0) first = image.frame;
    layout_.database_frames_of_frame[query_frame].push_back(image.frame);
    Frame& frame = layout_.given.frames.emplace_back();
    frame.frame_from_world = members[i].cam_from_world;
    frame.is_database = true;
  }
}

}  // namespace lazyloc
