#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/query_prior.h"

namespace lazyloc {

// What is known of a frame's pose beforehand. Deviations from it are stated in the world's axes, so that those of
// several frames compare.
struct PosePrior {
  Rigid3d frame_from_world;
  double rotation_stddev_rad = 0;  // about each axis
  double position_stddev = 0;      // of each coordinate of the frame's origin, in database units
};

// A rig at one moment, or a single image. Only frames have poses (COLMAP 4's words).
struct Frame {
  Rigid3d frame_from_world;
  bool is_database = false;
  // Database frames whose pose may be off: adjustment corrects frame_from_world as far as the prior lets it. Without a
  // prior a database frame is constant.
  std::optional<PosePrior> prior;
  // True if adjustment estimates a factor on the translations of the frame's cam_from_frame, or of their calibrations
  // (a trajectory without scale).
  bool has_free_scale = false;
  double scale = 1;  // the factor that has been estimated so far
};

// The place of a camera in its rig, common to the images that this camera takes at all moments.
struct Calibration {
  Rigid3d cam_from_frame;
  // The calibration may be off: adjustment corrects cam_from_frame as far as the prior lets it (its frame_from_world is
  // the stated cam_from_frame). Without a prior the images of the calibration have an exact cam_from_frame.
  std::optional<PosePrior> prior;
  // Standard deviations of the rig's place at one moment: no rig is perfectly rigid.
  double flex_rad = 0;     // of the rotation, about each axis
  double flex_length = 0;  // of each coordinate of the projection centre
  // True if database frames have the calibration. Their poses then define what is right: the poses of queries are
  // reported with the stated calibration too.
  bool is_stated_by_database = false;
};

// The depth map of an image as adjustment uses it: the log of a point's depth is that of the map plus log_scale, which
// adjustment estimates, plus an error.
struct DepthScale {
  double log_scale = 0;         // estimated so far
  double stated_log_scale = 0;  // before adjustment
  double log_scale_stddev = 1;  // of that
  double log_depth_stddev = 1;  // of a point's error
};

// An image of a frame:
//
//      image 0         image 1          cam_from_world = cam_from_frame * frame_from_world
//   (frame's axes)     /
//        +------------+  cam_from_frame: the rig offset, constant but for its calibration and the frame's scale
//         \          /
//          \ frame_from_world: one pose for all images of the frame
//
struct Image {
  int frame = -1;          // index into PosedImages::frames
  Rigid3d cam_from_frame;  // identity for the first image of a frame, whose axes are the frame's
  // Index into PosedImages::calibrations; -1 if cam_from_frame is exact, as it is in a constant frame.
  int calibration = -1;
  // Standard deviation of a keypoint's error, per coordinate: keypoint noise, and what errors of a database pose and of
  // the intrinsics look like in the image.
  double noise_px = 1;
  // Log of the factor on the focal length that adjustment estimates; nullopt if the focal length is known. At most one
  // image of a frame has it, and none of a constant frame or of one with has_free_scale.
  std::optional<double> log_focal_factor;
  std::optional<DepthScale> depth_scale;  // nullopt without a depth map in use
};

enum class PosePart { WHOLE, ROTATION, POSITION };

// A cause of deviations from priors. It contributes variance * shape(a, b) to the covariance of the deviations of
// frames a and b of a group, in each of the coordinates that it moves: all six, or those of the rotations or positions.
struct VarianceComponent {
  bool Moves(PosePart moved) const { return part == PosePart::WHOLE || part == moved; }

  Eigen::MatrixXd shape;
  double variance = 1;
  PosePart part = PosePart::WHOLE;
};

// Frames whose deviations from their priors are correlated. The variances refer to deviations in the priors' standard
// deviations.
struct PriorGroup {
  std::vector<int> frames;  // indices into PosedImages::frames, ascending; each has a prior
  std::vector<VarianceComponent> components;
  // Probability that the frames do not deviate at all. The variances are means that include this case.
  double exact_probability = 0;

  // The user stated the sizes of the errors, which are one component.
  bool HasStatedSizes() const { return components.size() == 1; }
};

// Images and the frames that carry them.
struct PosedImages {
  std::vector<Image> images;
  std::vector<Frame> frames;
  std::vector<Calibration> calibrations = {};
  std::vector<PriorGroup> prior_groups =
      {};  // disjoint; frames of no group deviate independently as their priors state
  std::vector<ImagePrior> query_priors = {};  // those that adjustment uses; not of images of constant frames

  const Frame& FrameOf(int image) const { return frames[images[image].frame]; }
  bool IsDatabase(int image) const { return FrameOf(image).is_database; }
};

// Returns true if adjustment takes the pose as exact.
inline bool IsConstant(const Frame& frame) { return frame.is_database && !frame.prior; }

// Returns true if the frame's axes are those of the image.
inline bool HasFrameAxes(const Image& image) {
  return image.cam_from_frame.rotation.coeffs() == Eigen::Vector4d::UnitW() &&
         image.cam_from_frame.translation.isZero(0);
}

// Returns the frame's own pose for an image with its axes, because composing with the identity would normalise the
// rotation and change its last bits.
inline Rigid3d CamFromWorld(const Image& image, const Rigid3d& frame_from_world) {
  return HasFrameAxes(image) ? frame_from_world : image.cam_from_frame * frame_from_world;
}

inline Rigid3d CamFromWorld(const PosedImages& posed, int image) {
  return CamFromWorld(posed.images[image], posed.FrameOf(image).frame_from_world);
}

// Returns the poses of all images.
inline std::vector<Rigid3d> CamsFromWorld(const PosedImages& posed) {
  std::vector<Rigid3d> cams_from_world;
  cams_from_world.reserve(posed.images.size());
  for (const Image& image : posed.images) {
    cams_from_world.push_back(CamFromWorld(image, posed.frames[image.frame].frame_from_world));
  }
  return cams_from_world;
}

}  // namespace lazyloc
