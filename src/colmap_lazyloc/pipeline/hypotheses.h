#pragma once

#include <optional>
#include <string>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

struct Choices;

// Method that gives the pose.
enum class Approach {
  TRACKS,  // adjustment over tracks, from the start that fits the matches best, motion averaging's among them
  OTHER_ORIENTATION,  // the same from the other orientation that a plane leaves beside a single database image
  POSITION_PRIOR,     // the same from where a prior puts a position that the images do not determine
  ROTATION,           // rotations alone; a prior is the position
  PAPER,              // the paper's method
};

// What is assumed of a group of queries. All but the approach is only for groups of one query.
struct Hypothesis {
  // True if the focal length is estimated. Motion averaging is then left out, because relative poses
  // estimated with a wrong focal length must not decide.
  bool estimates_focal_length = false;
  std::string only_database_image = {};  // the one whose pair alone is used; empty: all
  Approach approach = Approach::TRACKS;
};

// Returns the next hypothesis that is still worth trying; nullopt if there is none. The ordinary query has one. A group
// of several images is only solved as given, because images that drop out are solved individually (solve_group.cc).
std::optional<Hypothesis> NextHypothesis(const QueryGroup& group, const Choices& choices,
                                         const LocalizerOptions& options);

}  // namespace lazyloc
