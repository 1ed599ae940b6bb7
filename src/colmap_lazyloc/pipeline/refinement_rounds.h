#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/layout.h"
#include "colmap_lazyloc/pipeline/track_collection.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

// What the covariance of an adjustment lacks of the variance of a component of a prior group.
struct MissingVariance {
  size_t group, component;
  double variance;
};

// A line on which the images put a lone query, and the variance of its place there by a prior alone.
struct OpenLine {
  Eigen::Vector3d direction_in_world;
  double variance;
};

struct Refined {
  // Sets missing_variances by the adjustment and the variance factor.
  void SetMissingVariances();

  BundleAdjustmentResult adjustment;                 // the last one; its tracks are those that fit the result
  double variance_factor = 1;                        // of its images
  std::optional<OpenLine> open_line;                 // if a prior fixes the place on it
  std::optional<bool> has_one_orientation;           // of a lone query beside one database image (ChooseOrientation)
  std::vector<MissingVariance> missing_variances;    // ForEachMissingVariance
  std::vector<std::optional<double>> rig_errors_px;  // by query (rig_check.h)
};

// Refines poses by rounds of triangulation and bundle adjustment (LazyLoc, section 3.3), each with the noise of the
// images and of the database poses that the round before has found. start_tracks: the candidates for the start, as the
// start was chosen by. camera: for a query of unknown focal length, which each adjustment then changes; else null.
// Throws Failure if no pose comes of it.
Refined Refine(const Layout& layout, const PosedImages& start, const SplitTracks& start_tracks,
               CandidateTracks candidates, const LocalizerOptions& options, StageTimer::Seconds* seconds,
               QueryCamera* camera = nullptr);

}  // namespace lazyloc
