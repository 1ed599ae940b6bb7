#pragma once

#include <vector>

#include "colmap_lazyloc/scene/joint_scene.h"

namespace lazyloc {

// Mark that other marks and the survey contradict.
struct WrongMark {
  size_t control_point = 0;  // index into JointScene::control_points
  int image = -1;
  double error_px = 0;  // infinite behind the image
};

struct ControlMarks {
  // By control point of the scene: with the marks that fit, at the place that fits the poses. A point that nothing
  // fits, or that no adjusted image shows, has no observations.
  std::vector<JointPoint> points;
  std::vector<WrongMark> wrong;  // in the order of points and images
};

// Finds the marks that fit the survey where the poses have it: the poses and the survey may differ by a shift, which is
// the median over points of where the rays of their marks meet minus where they were surveyed. Marks in photos without
// points are left out.
ControlMarks FindFittingMarks(const JointScene& scene);

}  // namespace lazyloc
