#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/group/layout.h"

namespace lazyloc {

// Returns the index of the calibration with this cam_from_frame, up to rounding; adds one if there is none.
int FindOrAddCalibration(const Rigid3d& cam_from_frame, std::vector<Calibration>* calibrations);

// Adds the database images of a group to its layout, each once per query frame.
class DatabaseFrames {
 public:
  explicit DatabaseFrames(const QueryGroup& group, Layout* layout) : group_(group), layout_(*layout) {}

  // Returns the image of a pair, still without a frame.
  int AddImage(int query_frame, const ImagePair& pair);
  // Makes the frames after the last image. The images of a rig frame share one if the database poses state a rigid rig:
  // their relative poses are those of the query's rig, or of a second rig frame. Else each image is a frame by itself,
  // because images whose poses were estimated one by one do not share an error.
  void MakeFrames();

 private:
  struct Member {
    int image = -1;
    Rigid3d cam_from_world, cam_from_rig;
    Rigid3d cam_from_frame;  // by the poses of this member and the first
  };
  using Members = std::vector<Member>;  // of a rig frame; the first has the frame's axes

  void PlaceMembers(int query_frame, Members* members) const;
  std::vector<Calibration> StatedCalibrations() const;
  void MakeFrame(int query_frame, const Members& members);

  const QueryGroup& group_;
  Layout& layout_;
  std::map<std::pair<int, std::string>, int> image_of_name_;         // by query frame and name
  std::map<std::pair<int, std::string>, Members> members_of_frame_;  // by query frame and name
};

}  // namespace lazyloc
