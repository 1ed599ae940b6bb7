#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/epoch/control_marks.h"
#include "colmap_lazyloc/scene/joint_scene.h"
#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

struct AdjustedPhotos {
  StageSummary summary;
  // By photo, for the tangent (w, dt) of cam_from_world; not finite for photos that their points do not determine.
  std::vector<Eigen::Matrix<double, 6, 6>> covariances;
  ControlMarks control;       // at the adjusted places
  bool control_fits = false;  // FitAdjustedScene
};

// Triangulates the scene's points anew and adjusts it, three times, each time with the noise of the images that the
// time before has found. Leaves out observations that do not fit, and those of images with too few of them, which keep
// their poses. From the second time on, the poses of database images may be off as far as the images show; the photos
// are then moved to where they are relative to the database as given. With control points, which take part from the
// second time on, the photos are where the survey has them instead. Database images and constant cameras keep every
// bit. The scene's photos come before its database images.
AdjustedPhotos AdjustInRounds(JointScene* scene);

}  // namespace lazyloc
