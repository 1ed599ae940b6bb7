#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/intrinsics_parameter.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Camera that images of a joint scene share.
struct JointCamera {
  Camera camera;
  bool is_constant = false;
  IntrinsicsCovariance covariance = IntrinsicsCovariance::Zero();  // of a constant camera
};

// Image of a joint scene.
struct JointImage {
  int camera = -1;  // index into JointScene::cameras
  Rigid3d cam_from_world;
  bool is_database = false;
  double noise_px = 1;  // standard deviation of its keypoints per coordinate
  std::vector<Eigen::Vector2d> keypoints;
  // Of a database image whose pose may be off: adjustment corrects it as far as the prior lets it. Without a prior a
  // database image is constant.
  std::optional<PosePrior> prior = std::nullopt;
};

// Verified matches of two images. A match's other_point is a keypoint of image1, its query_point one of image2.
struct JointPair {
  int image1 = -1, image2 = -1;
  Matches matches;
};

struct JointObservation {
  int image = -1;
  uint32_t keypoint = 0;
};

// What a survey says of a point. The keypoints of its observations are marks that people have made.
struct Survey {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Eigen::Vector3d stddevs = Eigen::Vector3d::Ones();
  double mark_noise_px = 1;  // standard deviation of the marks per coordinate
};

struct JointPoint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  std::vector<JointObservation> observations;   // at most one per image, sorted by image
  std::optional<Survey> survey = std::nullopt;  // of a control point
};

// New photos and the database images that they share matches with. The origin of the world is near the cameras.
struct JointScene {
  std::vector<JointCamera> cameras;
  std::vector<JointImage> images;
  std::vector<JointPair> pairs;
  std::vector<JointPoint> points;
  std::vector<JointPoint> control_points = {};  // with all of their marks; adjusted if they are among the points
  // Roots R of the inverse covariance R^T R of the deviations from the priors, in their standard deviations: of one
  // coordinate of the rotations and of the positions, with a column for each image with a prior.
  Eigen::SparseMatrix<double, Eigen::RowMajor> rotation_root = {}, position_root = {};
};

}  // namespace lazyloc
