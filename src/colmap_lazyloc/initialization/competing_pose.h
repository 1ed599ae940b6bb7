#pragma once

#include <optional>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Share of explained matches from which on a competing pose is not searched: it would have at most a fourth of the
// pose's score, and odds as small as those that remain with perfect evidence.
inline constexpr double kEnoughExplained = 0.8;

// A pose that explains what another one does not.
struct CompetingPose {
  Rigid3d frame_from_world;
  double score_ratio = 0;  // its score over that of the other pose (ScoreStart)
};

// Returns the best absolute pose by the points from the database that a query frame's pose does not explain; nullopt
// without any. from_database, rest: the tracks of the frame, with points and without. The scores are those over all
// tracks, with the database poses as given, so that neither pose profits from their corrections, which can explain
// wrong matches.
std::optional<CompetingPose> FindCompetingPose(const Layout& layout, const TrackRefs& from_database,
                                               const TrackRefs& rest, int frame, const Rigid3d& frame_from_world,
                                               int seed);

}  // namespace lazyloc
