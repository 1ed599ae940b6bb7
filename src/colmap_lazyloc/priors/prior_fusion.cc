#include "colmap_lazyloc/priors/prior_fusion.h"

#include <utility>

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

// Compares the priors of a query with its pose. Returns the equations of those that are used, around the camera.
Equations CompareWithPose(const QueryPrior& prior, const PoseDistribution& pose, QueryPriorResult* result) {
  const Rigid3d around_camera{pose.cam_from_world.rotation, Eigen::Vector3d::Zero()};
  Equations equations;
  if (prior.position) {
    auto used = UsedPrior(*prior.position, ComparePosition(*prior.position, pose), &result->position);
    if (used) {
      used->position -= CamInWorld(pose.cam_from_world);
      equations.Set(0, EvaluatePositionPrior(*used, {}, around_camera));
    }
  }
  if (prior.gravity) {
    const PriorComparison comparison =
        CompareGravity(*prior.gravity, around_camera.rotation, pose.RotationCovariance());
    const auto used = UsedPrior(*prior.gravity, comparison, &result->gravity);
    if (used) equations.Set(3, EvaluateGravityPrior(*used, {}, around_camera));
  }
  return equations;
}

bool IsUntested(const QueryPriorResult& result) {
  return (!result.position || result.position->verdict == PriorVerdict::NOT_TESTED) &&
         (!result.gravity || result.gravity->verdict == PriorVerdict::NOT_TESTED);
}

}  // namespace

bool IsFused(const Layout& layout, const PosedImages& posed, int query) {
  const int frame = layout.FrameOf(query);
  return layout.QueriesOf(frame).size() == 1 && !posed.images[query].log_focal_factor;
}

FusedPriors FusePriors(const Layout& layout, std::vector<QueryPriorResult> results, CheckedIntrinsics checked) {
  FusedPriors fused{std::move(checked), std::move(results)};
  for (int query = 0; query < layout.num_queries; ++query) {
    const QueryPrior& prior = layout.priors[query];
    if ((!prior.position && !prior.gravity) || !IsFused(layout, fused.checked.posed, query)) continue;
    if (!IsUntested(fused.results[query])) continue;
    PoseDistribution& pose = fused.checked.poses[query];
    const Equations equations = CompareWithPose(prior, pose, &fused.results[query]);
    if (equations.jacobian.isZero(0)) continue;
    pose.Update(equations.errors, equations.jacobian);
    fused.checked.posed.frames[layout.FrameOf(query)].frame_from_world = pose.cam_from_world;
  }
  return fused;
}

}  // namespace lazyloc
