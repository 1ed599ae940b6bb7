#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/joint_adjustment.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/scene/joint_scene.h"

namespace lazyloc {

// Errors of the database poses in a joint scene, as the localizer models them (noise/database_priors.h): the photos
// count as one query frame, and the errors are relative to that at the viewpoint of the first photo. With more database
// images than a dense matrix solves, their precision is approximated by a sparse one, and the sizes of the errors are
// estimated by the images nearest to that viewpoint.
// With control points, there is an error that all database positions have in common, too, and photos stay where the
// adjustment has them.
class DatabaseErrors {
 public:
  // given: a scene with the database poses as given; the photos come before the database images.
  explicit DatabaseErrors(const JointScene& given);

  // Gives the database images that observe points priors.
  void SetPriors(JointScene* scene);
  // Estimates the sizes of the errors from an adjustment under the priors.
  void Estimate(const JointScene& scene, const JointAdjustment& adjustment);
  // Returns the covariance of each photo's pose for the tangent (w, dt) of cam_from_world, relative to the database as
  // given, or to the survey of control points, with the error of constant intrinsics; not finite for photos that are
  // not adjusted.
  std::vector<Eigen::Matrix<double, 6, 6>> PhotoCovariances(const JointScene& scene,
                                                            const JointAdjustment& adjustment) const;
  // Gives the database images their given poses, and, without control points, moves each adjusted photo by the error
  // that is expected at its viewpoint.
  void ReturnToGivenDatabase(const JointAdjustment& adjustment, JointScene* scene) const;

 private:
  size_t FrameOf(size_t image) const { return image + 1 - layout_.num_queries; }  // image: of the database
  PosedImages PosedBy(const JointScene& scene) const;

  bool is_surveyed_;  // by control points
  Layout layout_;
  DatabasePriors priors_;
  PosedImages posed_;  // with the priors that were set last
};

}  // namespace lazyloc
