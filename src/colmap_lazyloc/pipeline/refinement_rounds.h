#pragma once

#include <optional>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/query_camera.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/structure/track_triangulation.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Refines poses by rounds of triangulation and bundle adjustment (LazyLoc, section 3.3), each with the noise of the
// images and of the database poses that the round before has found. start_tracks: the tracks that ChooseStart scored
// poses with. camera: of a query of unknown focal length, as at the start; each adjustment changes it. Throws Failure
// if refinement fails.
Refined Refine(const Layout& layout, const PosedImages& start, const SplitTracks& start_tracks,
               CandidateTracks candidates, const LocalizerOptions& options, StageTimer::Seconds* seconds,
               std::optional<QueryCamera> camera = {});

}  // namespace lazyloc
