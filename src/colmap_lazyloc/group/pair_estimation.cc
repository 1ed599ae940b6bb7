#include "colmap_lazyloc/group/pair_estimation.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {
namespace {

// A pair before its keypoints are unprojected.
struct VerifiedPair {
  int query = -1, other = -1;  // images
  const ImagePair* images = nullptr;
  const RelativePose* relative_pose = nullptr;
};

std::optional<RelativePose> Find(bool uses_focal_length, const LocalizationProblem& problem, const ImagePair& pair,
                                 uint32_t seed) {
  if (uses_focal_length) return FindRelativePose(problem, pair, seed);
  Matches matches = FindInlierMatches(problem, pair, seed);
  if (matches.empty()) return std::nullopt;
  return RelativePose{{}, std::move(matches)};
}

// Returns the max_num_pairs pairs with most inliers, in their order; all pairs if max_num_pairs is zero.
std::vector<VerifiedPair> BestPairs(std::vector<VerifiedPair> pairs, size_t max_num_pairs) {
  if (max_num_pairs == 0 || pairs.size() <= max_num_pairs) return pairs;
  std::vector<size_t> order(pairs.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return pairs[a].relative_pose->inlier_matches.size() > pairs[b].relative_pose->inlier_matches.size();
  });
  order.resize(max_num_pairs);
  std::sort(order.begin(), order.end());
  std::vector<VerifiedPair> best;
  for (const size_t i : order) best.push_back(std::move(pairs[i]));
  return best;
}

// Throws for frames that no pair links to the database or to another frame.
void CheckLinks(const QueryGroup& group, const Layout& layout, const std::vector<VerifiedPair>& pairs) {
  std::vector<size_t> num_listed(layout.num_query_frames, 0);
  std::vector<bool> is_linked(layout.num_query_frames, false);
  for (const QueryImage& query : group.images) num_listed[query.frame] += query.problem.pairs.size();
  for (const VerifiedPair& pair : pairs) {
    const int frame = layout.FrameOf(pair.query), other_frame = layout.FrameOf(pair.other);
    if (frame == other_frame) continue;
    is_linked[frame] = true;
    if (!layout.IsDatabase(pair.other)) is_linked[other_frame] = true;
  }
  CheckFrames(layout.num_query_frames, QueryStatus::TOO_FEW_INLIERS, [&](int frame) {
    if (is_linked[frame]) return Reason();
    return Reason("none of " + std::to_string(num_listed[frame]) + " pairs has " + std::to_string(kMinNumInliers) +
                  " verified inliers");
  });
}

// Unprojects the keypoints of inliers, those of queries once for all pairs.
std::vector<PairGeometry> ObservePairs(const QueryGroup& group, const Layout& layout,
                                       const std::vector<VerifiedPair>& verified) {
  std::vector<Observer> observers;  // by query
  // Holds [query][keypoint], as needed. Outer nullopt: not computed yet; inner: the keypoint cannot be unprojected.
  std::vector<std::vector<std::optional<std::optional<Observation>>>> known;
  for (const QueryImage& query : group.images) {
    observers.emplace_back(query.problem.query_camera);
    known.emplace_back(query.problem.query_keypoints.size());
  }
  const auto observe_query = [&](int query, uint32_t keypoint) -> const std::optional<Observation>& {
    std::optional<std::optional<Observation>>& observation = known[query][keypoint];
    if (!observation) observation = observers[query](group.images[query].problem.query_keypoints[keypoint]);
    return *observation;
  };
  std::vector<PairGeometry> pairs;
  for (const VerifiedPair& pair : verified) {
    const Observer observe_database(pair.images->other_camera);
    const Matches& matches = pair.relative_pose->inlier_matches;
    PairGeometry& geometry = pairs.emplace_back();
    geometry.query = pair.query;
    geometry.other = pair.other;
    geometry.query_from_other = pair.relative_pose->query_from_other;
    geometry.num_inliers = static_cast<int>(matches.size());
    geometry.inliers.reserve(matches.size());
    for (const Match& match : matches) {
      const std::optional<Observation>& query = observe_query(pair.query, match.query_point);
      const std::optional<Observation> other = layout.IsDatabase(pair.other)
                                                   ? observe_database(pair.images->other_keypoints[match.other_point])
                                                   : observe_query(pair.other, match.other_point);
      if (query && other) geometry.inliers.push_back({match, *query, *other});
    }
  }
  return pairs;
}

}  // namespace

PairEstimates EstimatePairs(const QueryGroup& group, const Layout& layout, bool uses_focal_length,
                            const LocalizerOptions& options, KnownRelativePoses* known, StageTimer::Seconds* seconds) {
  PairEstimates estimates;
  std::vector<VerifiedPair> verified;
  {
    const StageTimer timer("two_view", seconds);
    const auto verify = [&](int query, int other, const ImagePair& images, std::vector<VerifiedPair>* pairs) {
      const LocalizationProblem& problem = group.images[query].problem;
      const auto [entry, is_new] =
          known->try_emplace({uses_focal_length, problem.query_name, !layout.IsDatabase(other), images.other_name});
      std::optional<RelativePose>& relative_pose = entry->second;
      if (is_new) {
        relative_pose = Find(uses_focal_length, problem, images,
                             SeedFromNames(problem.query_name, images.other_name, options.seed));
      }
      if (!relative_pose) return 0;
      pairs->push_back({query, other, &images, &*relative_pose});
      return static_cast<int>(relative_pose->inlier_matches.size());
    };
    for (int query = 0; query < layout.num_queries; ++query) {
      const std::vector<ImagePair>& pairs = group.images[query].problem.pairs;
      std::vector<VerifiedPair> of_query;
      estimates.num_inliers.emplace_back();
      for (size_t i = 0; i < pairs.size(); ++i) {
        estimates.num_inliers.back().push_back(verify(query, layout.image_of_pair[query][i], pairs[i], &of_query));
      }
      of_query = BestPairs(std::move(of_query), static_cast<size_t>(group.images[query].problem.max_num_pairs));
      std::move(of_query.begin(), of_query.end(), std::back_inserter(verified));
    }
    for (const QueryPair& pair : group.query_pairs) verify(pair.query, pair.other, pair.images, &verified);
    CheckLinks(group, layout, verified);
  }
  estimates.pairs = Timed("observations", seconds, [&] { return ObservePairs(group, layout, verified); });
  return estimates;
}

}  // namespace lazyloc
