#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

struct Outcome {
  std::vector<LocalizationResult> results;  // by image of the group
  std::vector<int> failed_frames;           // all frames if the failure is one of the whole group
};

// Localizes all frames of a group in one solve: the method, stage by stage.
Outcome LocalizeTogether(const QueryGroup& group, const LocalizerOptions& options);

// Localizes a lone query whose pairs contradict each other by all starts but motion averaging, with the matches of all
// pairs: points that two database images triangulate may fix a pose although relative poses are wrong.
Outcome LocalizeByOtherStarts(const QueryGroup& query, const LocalizerOptions& options);

// Localizes a lone query of unknown focal length. Motion averaging has no part in it, because relative poses estimated
// with a wrong focal length must not decide.
Outcome LocalizeWithUnknownFocalLength(const QueryGroup& query, const LocalizerOptions& options);

// Localizes a lone query without any baseline, whose rotation is known: a prior is its position.
Outcome LocalizeByRotation(const QueryGroup& query, const LocalizerOptions& options);

// Localizes a lone query by one of the paper's alternatives to adjustment over tracks. Its covariance is unknown (NaN).
Outcome LocalizeWithoutTracks(const QueryGroup& query, const LocalizerOptions& options);

}  // namespace lazyloc
