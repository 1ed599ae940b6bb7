#include "colmap_lazyloc/initialization/competing_pose.h"

#include <algorithm>

#include "colmap_lazyloc/initialization/start_selection.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {

std::optional<CompetingPose> FindCompetingPose(const Layout& layout, const TrackRefs& from_database,
                                               const TrackRefs& rest, int frame, const Rigid3d& frame_from_world,
                                               int seed) {
  const auto problem_of = [&](const TrackRefs& points, const TrackRefs& others) {
    StartProblem problem{layout.given, points, others, kMaxStartErrorPx};
    problem.frame = frame;
    return problem;
  };
  TrackRefs unexplained;
  for (const Track* track : from_database) {
    if (ScoreStart(problem_of({track}, {}), frame_from_world) == 0) unexplained.push_back(track);
  }
  const std::optional<Rigid3d> competing = AbsolutePoseStart(
      problem_of(unexplained, {}), SeedFromNames(layout.names[layout.QueriesOf(frame).front()], "competing", seed));
  if (!competing) return std::nullopt;
  const StartProblem all = problem_of(from_database, rest);
  return CompetingPose{*competing, ScoreStart(all, *competing) / std::max(ScoreStart(all, frame_from_world), 1.0)};
}

}  // namespace lazyloc
