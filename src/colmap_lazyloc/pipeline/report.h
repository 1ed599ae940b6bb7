#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/failure.h"
#include "colmap_lazyloc/pipeline/motion_averaging.h"
#include "colmap_lazyloc/pipeline/pair_estimation.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/start_selection.h"

namespace lazyloc {

// Collects the results of a group while its stages run, so that queries that cannot be localized have what was known
// until then.
class Report {
 public:
  explicit Report(const QueryGroup& group);

  StageTimer::Seconds* Seconds() { return &seconds_; }

  void AddPairs(const PairEstimates& estimates);
  // Adds the errors that are expected of the database poses.
  void AddPoseErrors(const Layout& layout);
  void AddStart(const Layout& layout, const Start& start);
  // Adds the queries' poses.
  void AddPoses(const Layout& layout, const PosedImages& posed);
  // Adds the deviations of the pairs' rotations and directions from the final poses.
  void AddPairErrors(const Layout& layout, const Averaged& averaged, const PosedImages& posed);
  void AddRefined(const Layout& layout, const Refined& refined);
  void AddUncertainties(const std::vector<PoseUncertainty>& uncertainties);
  void AddPriors(const std::vector<QueryPriorResult>& priors);
  void AddIntrinsics(const std::vector<IntrinsicsResult>& intrinsics);
  // Adds the confidence in each query's pose. Queries below min_confidence become LOW_CONFIDENCE. evidence: by frame.
  void AddEvidence(const Layout& layout, const std::vector<PoseEvidence>& evidence, double min_confidence);
  // Adds the cameras that were estimated or corrected; nullopt for others. By query.
  void AddCameras(const std::vector<std::optional<Camera>>& cameras);
  // Adds what became of the depth maps, and what they contribute to the poses. results: by query.
  void AddDepths(const std::vector<DepthResult>& results);
  void AddDepthsOfPoses(const Layout& layout, const Refined& refined, const LocalizerOptions& options);
  void AddFailure(const Failure& failure);

  // Returns the results; LOCALIZED unless a failure was added.
  std::vector<LocalizationResult> Finish() &&;

 private:
  const QueryGroup& group_;
  std::vector<LocalizationResult> results_;
  StageTimer::Seconds seconds_;
};

}  // namespace lazyloc
