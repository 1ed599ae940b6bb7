#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/depths/depth_maps_in_use.h"
#include "colmap_lazyloc/initialization/start_selection.h"
#include "colmap_lazyloc/intrinsics/intrinsics_check.h"
#include "colmap_lazyloc/pipeline/prepare.h"
#include "colmap_lazyloc/uncertainty/evidence_measurement.h"

namespace lazyloc {

struct Choice;

// What comes of a hypothesis: values of the solve, and no judgement on them. A failed one has what was known until
// then.
struct Solution {
  Hypothesis hypothesis;
  const Prepared* prepared = nullptr;
  std::optional<Failure> failure;  // nullopt if there are poses

  Averaged averaged;                                    // pairs in use
  std::vector<StartPose> starts;                        // by query frame; empty without any
  std::vector<DepthResult> depths;                      // by query; empty without depth maps
  std::vector<QueryPriorResult> priors;                 // by query
  std::optional<Refined> refined;                       // nullopt if nothing was adjusted over tracks
  CheckedIntrinsics checked;                            // the poses as reported, with uncertainties and intrinsics
  std::vector<PoseEvidence> evidence;                   // by query frame; empty if unknown
  std::vector<std::optional<Rigid3d>> competing_poses;  // by query frame, parallel to the evidence
  // What adjustment over tracks began with, the start among it, if it may begin again elsewhere; else null.
  std::shared_ptr<const StartInput> input;
  // Where it may: the other orientation of a query beside one database image, if the position is unobservable.
  std::optional<Rigid3d> other_orientation;
};

// Solves a group under a hypothesis: the method, stage by stage. Adds the stages' wall times. given: the choice among
// the solutions with given intrinsics so far, which some approaches go on from; null for the first one.
Solution Solve(const Prepared& prepared, const Hypothesis& hypothesis, const Choice* given,
               const LocalizerOptions& options, StageTimer::Seconds* seconds);

}  // namespace lazyloc
