#pragma once

#include <limits>
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
  // Median distance from where the rays of a point's marks meet to where it was surveyed; not finite if none meet.
  double median_distance = std::numeric_limits<double>::quiet_NaN();
};

// Error above which a mark is wrong, in standard deviations of marks.
constexpr double kMaxMarkErrorSigma = 5;

// Finds the marks that fit the survey where the poses have it: the poses and the survey may differ by a shift, which is
// the median over points of where the rays of their marks meet minus where they were surveyed. Marks in photos without
// points are left out.
ControlMarks FindFittingMarks(const JointScene& scene);

// True if most of the marks that fitted each other still fit after adjustment with the survey. If the survey
// contradicts the photos, adjustment leaves the marks far from their points, because it can bend neither enough.
bool FitAdjustedScene(const ControlMarks& marks, const JointScene& scene);

}  // namespace lazyloc
