#include "colmap_lazyloc/group/layout.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

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

// Returns the index of the calibration with this cam_from_frame, up to rounding; -1 if there is none.
int FindCalibration(const Rigid3d& cam_from_frame, const std::vector<Calibration>& calibrations) {
  const auto found = std::find_if(calibrations.begin(), calibrations.end(), [&](const Calibration& calibration) {
    return IsSame(cam_from_frame, calibration.cam_from_frame);
  });
  return found == calibrations.end() ? -1 : static_cast<int>(found - calibrations.begin());
}

// Adds the calibration if there is none.
int FindOrAddCalibration(const Rigid3d& cam_from_frame, std::vector<Calibration>* calibrations) {
  const int found = FindCalibration(cam_from_frame, *calibrations);
  if (found >= 0) return found;
  calibrations->emplace_back().cam_from_frame = cam_from_frame;
  return static_cast<int>(calibrations->size()) - 1;
}

void AddQuery(const QueryGroup& group, const QueryImage& query, Layout* layout) {
  Image image;
  image.frame = query.frame;
  if (query.frame == layout->num_query_frames) {
    layout->given.frames.emplace_back();
    layout->queries_of_frame.emplace_back();
    layout->database_frames_of_frame.emplace_back();
    ++layout->num_query_frames;
  } else {
    const int first = layout->QueriesOf(query.frame).front();
    image.cam_from_frame = query.cam_from_rig * Inverse(group.images[first].cam_from_rig);
    layout->given.frames[query.frame].has_free_scale = !group.has_rig_scale;
    std::vector<Calibration>* calibrations = &layout->given.calibrations;
    if (group.has_rig_scale) {
      image.calibration = FindOrAddCalibration(image.cam_from_frame, calibrations);
    } else {
      image.calibration = static_cast<int>(calibrations->size());  // of its own, because frames differ in their scales
      calibrations->emplace_back().cam_from_frame = image.cam_from_frame;
    }
  }
  layout->queries_of_frame[query.frame].push_back(static_cast<int>(layout->given.images.size()));
  layout->given.images.push_back(image);
  layout->names.push_back(query.problem.query_name);
  layout->priors.push_back(query.problem.prior);
  std::optional<PositionPrior>& position = layout->priors.back().position;
  if (position) position->position -= layout->origin;
}

Eigen::Vector3d MeanDatabaseCentre(const QueryGroup& group) {
  size_t num_pairs = 0;
  for (const QueryImage& query : group.images) num_pairs += query.problem.pairs.size();
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const QueryImage& query : group.images) {
    for (const ImagePair& pair : query.problem.pairs) {
      mean += CamInWorld(pair.database_cam_from_world) / static_cast<double>(num_pairs);
    }
  }
  return mean;
}

// Adds the database images of a group to its layout, each once per query frame.
class DatabaseFrames {
 public:
  DatabaseFrames(const QueryGroup& group, Layout* layout) : group_(group), layout_(*layout) {}

  // Returns the image of a pair, still without a frame.
  int AddImage(int query_frame, const ImagePair& pair) {
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

  // Makes the frames after the last image. The images of a rig frame share one if the database poses state a rigid rig:
  // their relative poses are those of the query's rig, or of a second rig frame. Else each image is a frame by itself,
  // because images whose poses were estimated one by one do not share an error.
  void MakeFrames() {
    for (auto& [key, members] : members_of_frame_) PlaceMembers(key.first, &members);
    layout_.given.calibrations = StatedCalibrations();
    for (const auto& [key, members] : members_of_frame_) MakeFrame(key.first, members);
  }

 private:
  struct Member {
    int image = -1;
    Rigid3d cam_from_world, cam_from_rig;
    Rigid3d cam_from_frame;  // by the poses of this member and the first
  };
  using Members = std::vector<Member>;  // of a rig frame; the first has the frame's axes

  // Puts the camera of the frame's first query first: its images keep the database's poses, and a wrong calibration is
  // corrected in the other cameras. Sets the members' places in the frame.
  void PlaceMembers(int query_frame, Members* members) const {
    const Rigid3d& own = group_.images[layout_.QueriesOf(query_frame).front()].cam_from_rig;
    const auto order = [&](const Member& member) {
      return std::tuple(!IsSame(member.cam_from_rig, own), layout_.names[member.image]);
    };
    std::sort(members->begin(), members->end(), [&](const Member& a, const Member& b) { return order(a) < order(b); });
    const Rigid3d world_from_frame = Inverse(members->front().cam_from_world);
    for (Member& member : *members) member.cam_from_frame = member.cam_from_world * world_from_frame;
  }

  // Returns the calibrations of the queries, and those that two or more rig frames of the database have.
  std::vector<Calibration> StatedCalibrations() const {
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

  void MakeFrame(int query_frame, const Members& members) {
    int first = 0;
    for (size_t i = 0; i < members.size(); ++i) {
      Image& image = layout_.given.images[members[i].image];
      const int calibration = FindCalibration(members[i].cam_from_frame, layout_.given.calibrations);
      if (i > 0 && calibration >= 0) {
        image.frame = first;
        image.calibration = calibration;
        image.cam_from_frame = members[i].cam_from_frame;
        layout_.given.calibrations[calibration].is_stated_by_database = true;
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

  const QueryGroup& group_;
  Layout& layout_;
  std::map<std::pair<int, std::string>, int> image_of_name_;         // by query frame and name
  std::map<std::pair<int, std::string>, Members> members_of_frame_;  // by query frame and name
};

}  // namespace

Layout MakeLayout(const QueryGroup& group) {
  Layout layout;
  layout.num_queries = static_cast<int>(group.images.size());
  layout.origin = MeanDatabaseCentre(group);
  for (const QueryImage& query : group.images) AddQuery(group, query, &layout);
  DatabaseFrames database_frames(group, &layout);
  for (const QueryImage& query : group.images) {
    layout.image_of_pair.emplace_back();
    for (const ImagePair& pair : query.problem.pairs) {
      layout.has_depths = layout.has_depths || !pair.other_depths.empty();
      layout.image_of_pair.back().push_back(database_frames.AddImage(query.frame, pair));
    }
  }
  database_frames.MakeFrames();
  for (Image& image : layout.given.images) image.noise_px = kStartNoisePx;
  return layout;
}

Rigid3d PoseInWorld(const Layout& layout, const PosedImages& posed, int query) {
  const Rigid3d pose = CamFromWorld(posed, query);
  return {pose.rotation, pose.translation - pose.rotation * layout.origin};
}

std::vector<TrackRefs> TracksByFrame(const Layout& layout, const std::vector<Track>& tracks) {
  std::vector<TrackRefs> tracks_of(layout.num_query_frames);
  for (const Track& track : tracks) {
    int last_frame = -1;
    for (const TrackObservation& element : track.observations) {
      if (layout.IsDatabase(element.image)) break;
      if (layout.FrameOf(element.image) == last_frame) continue;
      last_frame = layout.FrameOf(element.image);
      tracks_of[last_frame].push_back(&track);
    }
  }
  return tracks_of;
}

}  // namespace lazyloc
