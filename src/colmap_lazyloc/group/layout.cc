#include "colmap_lazyloc/group/layout.h"

#include "colmap_lazyloc/group/database_frames.h"

namespace lazyloc {
namespace {

void AddQuery(const QueryGroup& group, const QueryImage& query, Layout* layout) {
  Image image;
  image.frame = query.frame;
  if (query.frame == layout->num_query_frames) {
    Frame frame;
    layout->given.frames.push_back(frame);
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
