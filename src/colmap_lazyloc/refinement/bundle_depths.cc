// The parts of the solver that depth maps need.
#include "colmap_lazyloc/refinement/bundle_solver.h"

namespace lazyloc {

template <int kSize>
void BundleSolver<kSize>::AddDepthMapPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians) {
  for (const BundleDepthMap& map : problem_.depth_maps) {
    const double error = (state.frames[map.frame].log_factor - map.log_scale) / map.stddev;
    system_.cost += 0.5 * error * error;
    (*frame_hessians)[map.frame](0, 0) += 1 / (map.stddev * map.stddev);
    system_.rhs[kSize * map.frame] -= error / map.stddev;
  }
}

template <int kSize>
bool BundleSolver<kSize>::Evaluate(const BundleState& state, const FreeObservation& coupling, size_t track,
                                   DepthError* error) const {
  const DepthObservation& depth = problem_.depths[coupling.depth];
  const ParameterBlock* frame = depth.frame < 0 ? nullptr : &state.frames[depth.frame];
  return error->Evaluate(depth, frame, state.frames[coupling.frame].log_factor, state.points[track]);
}

template <int kSize>
void BundleSolver<kSize>::AddDepth(const DepthError& error, size_t coupling, size_t track,
                                   std::vector<FrameMatrix>* frame_hessians) {
  const int map = problem_.free[coupling].frame, frame = problem_.depths[problem_.free[coupling].depth].frame;
  (*frame_hessians)[map](0, 0) += error.by_log_scale * error.by_log_scale;
  system_.rhs[kSize * map] -= error.by_log_scale * error.error;
  system_.eliminated[coupling].setZero();
  system_.eliminated[coupling].row(0) = error.by_log_scale * error.by_point_in_world.transpose();
  if (frame < 0) return;
  (*frame_hessians)[frame].template topLeftCorner<6, 6>() += error.by_frame * error.by_frame.transpose();
  system_.rhs.template segment<6>(kSize * frame) -= error.by_frame * error.error;
  camera_system_.Block(map, frame, &system_.reduced).row(0).template head<6>() +=
      error.by_log_scale * error.by_frame.transpose();
  // Adds the coupling of frame and point to that of the image's keypoint.
  for (size_t i = problem_.free_range[track].begin; i < coupling; ++i) {
    if (problem_.free[i].frame != frame) continue;
    system_.eliminated[i].template topRows<6>() += error.by_frame * error.by_point_in_world.transpose();
    return;
  }
}

template void BundleSolver<6>::AddDepthMapPriors(const BundleState&, std::vector<FrameMatrix>*);
template bool BundleSolver<6>::Evaluate(const BundleState&, const FreeObservation&, size_t, DepthError*) const;
template void BundleSolver<6>::AddDepth(const DepthError&, size_t, size_t, std::vector<FrameMatrix>*);
template void BundleSolver<7>::AddDepthMapPriors(const BundleState&, std::vector<FrameMatrix>*);
template bool BundleSolver<7>::Evaluate(const BundleState&, const FreeObservation&, size_t, DepthError*) const;
template void BundleSolver<7>::AddDepth(const DepthError&, size_t, size_t, std::vector<FrameMatrix>*);

}  // namespace lazyloc
