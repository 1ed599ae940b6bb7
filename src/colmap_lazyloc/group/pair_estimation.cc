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

// Unprojects keypoints, those of queries once for all pairs.
class KeypointObserver {
 public:
  explicit KeypointObserver(const QueryGroup& group) : group_(group) {
    for (const QueryImage& query : group.images) {
      observers_.emplace_back(query.problem.query_camera);
      cache_.emplace_back(query.problem.query_keypoints.size());
    }
  }

  PairGeometry Observe(const VerifiedPair& pair, bool is_database_pair) {
    const Observer observe_database(pair.images->other_camera);
    PairGeometry geometry;
    geometry.query = pair.query;
    geometry.other = pair.other;
    geometry.query_from_other = pair.relative_pose->query_from_other;
    geometry.num_inliers = static_cast<int>(pair.relative_pose->inlier_matches.size());
    geometry.inliers.reserve(pair.relative_pose->inlier_matches.size());
    for (const Match& match : pair.relative_pose->inlier_matches) {
      const std::optional<Observation>& query = ObserveQuery(pair.query, match.query_point);
      const std::optional<Observation> other = is_database_pair
                                                   ? observe_database(pair.images->other_keypoints[match.other_point])
                                                   : ObserveQuery(pair.other, match.other_point);
      if (query && other) geometry.inliers.push_back({match, *query, *other});
    }
    return geometry;
  }

 private:
  const std::optional<Observation>& ObserveQuery(int query, uint32_t keypoint) {
    std::optional<std::optional<Observation>>& observation = cache_[query][keypoint];
    if (!observation) observation = observers_[query](group_.images[query].problem.query_keypoints[keypoint]);
    return *observation;
  }

  const QueryGroup& group_;
  std::vector<Observer> observers_;  // by query
  // Lazily filled cache [query][keypoint]. Outer nullopt: not computed yet; inner: the keypoint cannot be unprojected.
  std::vector<std::vector<std::optional<std::optional<Observation>>>> cache_;
};

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
      of_query = BestPairs(std::move(of_query), static_cast<size_t>(options.max_num_pairs));
      std::move(of_query.begin(), of_query.end(), std::back_inserter(verified));
    }
    for (const QueryPair& pair : group.query_pairs) verify(pair.query, pair.other, pair.images, &verified);
    CheckLinks(group, layout, verified);
  }
  const StageTimer timer("observations", seconds);
  KeypointObserver observer(group);
  for (const VerifiedPair& pair : verified) {
    estimates.pairs.push_back(observer.Observe(pair, layout.IsDatabase(pair.other)));
  }
  return estimates;
}

}  // namespace lazyloc
