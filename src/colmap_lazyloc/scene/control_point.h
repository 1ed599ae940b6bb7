#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// Where a person sees a control point in an image, in COLMAP's pixels.
struct ControlMark {
  std::string image_name;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// Surveyed point that is marked in images.
struct ControlPoint {
  std::string name;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();    // in the coordinates of the model
  Eigen::Vector3d stddevs = Eigen::Vector3d::Zero();  // of its coordinates
  std::vector<ControlMark> marks;
};

}  // namespace lazyloc
