#include "colmap_lazyloc/priors/prior_fusion.h"

#include <cmath>

#include "colmap_lazyloc/priors/prior_comparison.h"
#include "colmap_lazyloc/refinement/query_prior_residual.h"

namespace lazyloc {
namespace {

// Up to three residuals of a prior in its standard deviations, and their derivative by the tangent of the pose.
struct Equations {
  PoseDistribution::Vector errors = PoseDistribution::Vector::Zero();
  PoseDistribution::Matrix jacobian = PoseDistribution::Matrix::Zero();

  void Set(int row, const QueryPriorResidual& residual) {
    errors.segment<3>(row) = residual.error;
    jacobian.middleRows<3>(row) = residual.jacobian.leftCols<6>();
  }
};

// Compares the priors with a pose, and returns the equations of those that are used, around the camera.
Equations UsedEquations(QueryPrior prior, const PoseDistribution& pose, QueryPriorResult* result) {
  const Rigid3d around_camera{pose.cam_from_world.rotation, Eigen::Vector3d::Zero()};
  Equations equations;
  if (prior.position) {
    prior.position->covariance *= ComparePosition(*prior.position, pose, &*result->position);
    prior.position->position -= CamInWorld(pose.cam_from_world);
    if (result->position->verdict == PriorVerdict::USED) {
      equations.Set(0, EvaluatePositionPrior(*prior.position, {}, around_camera));
    }
  }
  if (prior.gravity) {
    prior.gravity->stddev_rad *=
        std::sqrt(CompareGravity(*prior.gravity, around_camera.rotation, pose.RotationCovariance(), &*result->gravity));
    if (result->gravity->verdict == PriorVerdict::USED) {
      equations.Set(3, EvaluateGravityPrior(*prior.gravity, {}, around_camera));
    }
  }
  return equations;
}

bool IsUntested(const QueryPriorResult& result) {
  return (!result.position || result.position->verdict == PriorVerdict::NOT_TESTED) &&
         (!result.gravity || result.gravity->verdict == PriorVerdict::NOT_TESTED);
}

void FusePriorsOf(const Layout& layout, int query, QueryPriorResult* result, CheckedIntrinsics* checked) {
  PoseDistribution& pose = checked->poses[query];
  const Equations equations = UsedEquations(layout.priors[query], pose, result);
  if (equations.jacobian.isZero(0)) return;
  pose.Update(equations.errors, equations.jacobian);
  checked->posed.frames[layout.FrameOf(query)].frame_from_world = pose.cam_from_world;
}

}  // namespace

bool IsFused(const Layout& layout, const PosedImages& posed, int query) {
  const int frame = layout.FrameOf(query);
  return layout.QueriesOf(frame).size() == 1 && !posed.images[query].log_focal_factor;
}

void FusePriors(const Layout& layout, std::vector<QueryPriorResult>* results, CheckedIntrinsics* checked) {
  for (int query = 0; query < layout.num_queries; ++query) {
    const QueryPrior& prior = layout.priors[query];
    if ((!prior.position && !prior.gravity) || !IsFused(layout, checked->posed, query)) continue;
    QueryPriorResult& result = (*results)[query];
    if (IsUntested(result)) FusePriorsOf(layout, query, &result, checked);
  }
}

}  // namespace lazyloc
