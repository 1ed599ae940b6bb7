#include "colmap_lazyloc/pipeline/layout.h"

#include <map>
#include <utility>

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
  }
  layout->queries_of_frame[query.frame].push_back(static_cast<int>(layout->given.images.size()));
  layout->given.images.push_back(image);
  layout->names.push_back(query.problem.query_name);
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

// Adds the database images of query frames, each once per frame.
class DatabaseImages {
 public:
  DatabaseImages(bool share_frames, Layout* layout) : share_frames_(share_frames), layout_(*layout) {}

  // Returns the image of a pair.
  int Find(int query_frame, const ImagePair& pair) {
    const int next = static_cast<int>(layout_.given.images.size());
    const auto [image, is_new] = image_of_name_.emplace(std::pair(query_frame, pair.other_name), next);
    if (is_new) Add(query_frame, pair);
    return image->second;
  }

 private:
  void Add(int query_frame, const ImagePair& pair) {
    Rigid3d cam_from_world = pair.database_cam_from_world;
    cam_from_world.rotation.normalize();
    cam_from_world.translation += cam_from_world.rotation * layout_.origin;
    const int next = static_cast<int>(layout_.given.frames.size());
    Image image;
    image.frame = next;
    if (share_frames_ && !pair.database_frame_name.empty()) {
      image.frame = frame_of_name_.emplace(std::pair(query_frame, pair.database_frame_name), next).first->second;
    }
    if (image.frame == next) {
      Frame frame;
      frame.frame_from_world = cam_from_world;
      frame.is_database = true;
      layout_.given.frames.push_back(frame);
      layout_.database_frames_of_frame[query_frame].push_back(next);
    } else {
      image.cam_from_frame = cam_from_world * Inverse(layout_.given.frames[image.frame].frame_from_world);
    }
    layout_.given.images.push_back(image);
    layout_.names.push_back(pair.other_name);
  }

  const bool share_frames_;
  Layout& layout_;
  std::map<std::pair<int, std::string>, int> image_of_name_, frame_of_name_;  // by query frame and name
};

}  // namespace

Layout MakeLayout(const QueryGroup& group, const LocalizerOptions& options) {
  Layout layout;
  layout.num_queries = static_cast<int>(group.images.size());
  layout.origin = MeanDatabaseCentre(group);
  for (const QueryImage& query : group.images) AddQuery(group, query, &layout);
  DatabaseImages database_images(options.share_database_frames, &layout);
  for (const QueryImage& query : group.images) {
    layout.image_of_pair.emplace_back();
    for (const ImagePair& pair : query.problem.pairs) {
      layout.image_of_pair.back().push_back(database_images.Find(query.frame, pair));
    }
  }
  for (Image& image : layout.given.images) image.noise_px = kStartNoisePx;
  return layout;
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
