#include "colmap_lazyloc/structure/track_building.h"

#include <algorithm>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace lazyloc {
namespace {

// A query with this many tracks of its own (rule 1) does not need other queries.
constexpr int kNumEnough = 100;

// Counts how often each keypoint is matched within a pair. A flat vector, because keypoint indices are dense.
class UseCounter {
 public:
  void Add(uint32_t keypoint) {
    if (keypoint >= uses_.size()) uses_.resize(keypoint + 1, 0);
    ++uses_[keypoint];
  }
  int operator[](uint32_t keypoint) const { return uses_[keypoint]; }
  void Clear(uint32_t keypoint) { uses_[keypoint] = 0; }

 private:
  std::vector<int> uses_;
};

// Returns the indices of each pair's matches whose keypoints are matched once.
std::vector<std::vector<size_t>> UnambiguousMatches(const PairRefs& pairs) {
  std::vector<std::vector<size_t>> unambiguous(pairs.size());
  UseCounter query, other;
  for (size_t pair = 0; pair < pairs.size(); ++pair) {
    const std::vector<ObservedMatch>& inliers = pairs[pair]->inliers;
    for (const ObservedMatch& inlier : inliers) {
      query.Add(inlier.match.query_point);
      other.Add(inlier.match.other_point);
    }
    unambiguous[pair].reserve(inliers.size());
    for (size_t i = 0; i < inliers.size(); ++i) {
      const Match& match = inliers[i].match;
      if (query[match.query_point] == 1 && other[match.other_point] == 1) unambiguous[pair].push_back(i);
    }
    for (const ObservedMatch& inlier : inliers) {
      query.Clear(inlier.match.query_point);
      other.Clear(inlier.match.other_point);
    }
  }
  return unambiguous;
}

// Builds the tracks of a single query: rule 1 alone, because nothing is left to merge. Gives what MatchGraph gives, in
// less time.
std::vector<Track> TracksOfOneQuery(const PairRefs& pairs) {
  const std::vector<std::vector<size_t>> unambiguous = UnambiguousMatches(pairs);
  std::vector<int> num_matches;  // by query keypoint
  for (size_t pair = 0; pair < pairs.size(); ++pair) {
    for (const size_t i : unambiguous[pair]) {
      const uint32_t query_point = pairs[pair]->inliers[i].match.query_point;
      if (query_point >= num_matches.size()) num_matches.resize(query_point + 1, 0);
      ++num_matches[query_point];
    }
  }
  std::vector<Track> tracks(num_matches.size() - std::count(num_matches.begin(), num_matches.end(), 0));
  std::vector<Track*> track_of_query_point(num_matches.size(), nullptr);
  auto next = tracks.begin();
  for (size_t query_point = 0; query_point < num_matches.size(); ++query_point) {
    if (num_matches[query_point] == 0) continue;
    next->observations.reserve(num_matches[query_point] + 1);
    track_of_query_point[query_point] = &*next++;
  }
  for (size_t pair = 0; pair < pairs.size(); ++pair) {
    for (const size_t i : unambiguous[pair]) {
      const ObservedMatch& inlier = pairs[pair]->inliers[i];
      std::vector<TrackObservation>& observations = track_of_query_point[inlier.match.query_point]->observations;
      if (observations.empty()) {
        observations.push_back({0, static_cast<int>(inlier.match.query_point), inlier.query});
      }
      observations.push_back({pairs[pair]->other, static_cast<int>(inlier.match.other_point), inlier.other});
    }
  }
  return tracks;
}

bool ComesBefore(const TrackObservation& a, const TrackObservation& b) {
  return std::tie(a.image, a.keypoint) < std::tie(b.image, b.keypoint);
}

// Graph of keypoints (nodes) and matches (links).
class MatchGraph {
 public:
  explicit MatchGraph(const std::vector<int>& frame_of_query)
      : frame_of_query_(frame_of_query), num_queries_(static_cast<int>(frame_of_query.size())) {}

  void Add(const PairGeometry& pair, const std::vector<size_t>& inlier_indices) {
    for (const size_t i : inlier_indices) {
      const ObservedMatch& inlier = pair.inliers[i];
      const int query = Node(pair.query, inlier.match.query_point, inlier.query);
      const int other = Node(pair.other, inlier.match.other_point, inlier.other);
      links_.emplace_back(query, other);
      num_database_links_[query] += pair.other >= num_queries_;
    }
  }

  std::vector<Track> Tracks() {
    CountOwnTracks();
    links_.erase(std::remove_if(links_.begin(), links_.end(), [this](const auto& link) { return IsRedundant(link); }),
                 links_.end());
    for (const auto& [query, other] : links_) {
      if (!HasOwnTrack(query) && !HasOwnTrack(other)) parents_[Root(query)] = Root(other);
    }
    std::vector<Track> joined(points_.size());  // by root
    for (size_t node = 0; node < points_.size(); ++node) {
      if (!HasOwnTrack(static_cast<int>(node))) {
        joined[Root(static_cast<int>(node))].observations.push_back(points_[node]);
      }
    }
    std::vector<bool> is_contradictory(points_.size(), false);
    for (size_t root = 0; root < joined.size(); ++root) {
      std::vector<TrackObservation>& observations = joined[root].observations;
      std::sort(observations.begin(), observations.end(), ComesBefore);
      is_contradictory[root] =
          std::adjacent_find(observations.begin(), observations.end(),
                             [](const auto& a, const auto& b) { return a.image == b.image; }) != observations.end();
    }
    std::vector<Track> tracks = TracksOfSingleQueries(is_contradictory, &joined);
    for (size_t root = 0; root < joined.size(); ++root) {
      const std::vector<TrackObservation>& observations = joined[root].observations;
      const bool is_track = observations.size() >= 2 && observations.front().image < num_queries_;
      if (is_track && !is_contradictory[root]) tracks.push_back(std::move(joined[root]));
    }
    std::sort(tracks.begin(), tracks.end(), [](const Track& a, const Track& b) {
      return ComesBefore(a.observations.front(), b.observations.front());
    });
    return tracks;
  }

 private:
  int Node(int image, uint32_t keypoint, const Observation& observation) {
    const auto [node, is_new] =
        nodes_.emplace(static_cast<uint64_t>(image) << 32 | keypoint, static_cast<int>(points_.size()));
    if (is_new) {
      points_.push_back({image, static_cast<int>(keypoint), observation});
      parents_.push_back(node->second);
      num_database_links_.push_back(0);
    }
    return node->second;
  }

  // Returns true if rule 1 holds for a query keypoint.
  bool HasOwnTrack(int node) const { return num_database_links_[node] >= 2; }

  void CountOwnTracks() {
    num_own_tracks_.assign(num_queries_, 0);
    for (size_t node = 0; node < points_.size(); ++node) {
      if (HasOwnTrack(static_cast<int>(node))) ++num_own_tracks_[points_[node].image];
    }
  }

  bool HasEnough(int node) const { return num_own_tracks_[points_[node].image] >= kNumEnough; }

  // Returns true if the link joins queries of different frames, each of which has enough tracks of its own.
  bool IsRedundant(const std::pair<int, int>& link) const {
    const int image1 = points_[link.first].image, image2 = points_[link.second].image;
    return image2 < num_queries_ && frame_of_query_[image1] != frame_of_query_[image2] && HasEnough(link.first) &&
           HasEnough(link.second);
  }

  int Root(int node) {
    while (parents_[node] != node) node = parents_[node] = parents_[parents_[node]];
    return node;
  }

  // Builds the tracks of query keypoints by rule 1 and rule 3, with the database keypoints that they are matched with.
  // The merged track of a query that has few tracks of its own is added to the first of these that it is matched with.
  std::vector<Track> TracksOfSingleQueries(const std::vector<bool>& is_contradictory, std::vector<Track>* joined) {
    std::unordered_map<int, Track> track_of_query_point;
    for (const auto& [query, other] : links_) {
      if (!(HasOwnTrack(query) || is_contradictory[Root(query)]) || points_[other].image < num_queries_) continue;
      Track& track = track_of_query_point[query];
      if (track.observations.empty()) track.observations.push_back(points_[query]);
      track.observations.push_back(points_[other]);
    }
    for (const auto& [query, other] : links_) {
      if (points_[other].image >= num_queries_ || HasOwnTrack(query) == HasOwnTrack(other)) continue;
      const int weak = HasOwnTrack(query) ? other : query, root = Root(weak);
      if (is_contradictory[root] || HasEnough(weak)) continue;
      Track& track = track_of_query_point[HasOwnTrack(query) ? query : other];
      for (const TrackObservation& element : (*joined)[root].observations) {
        const bool is_new = std::none_of(track.observations.begin(), track.observations.end(),
                                         [&](const TrackObservation& own) { return own.image == element.image; });
        if (is_new) track.observations.push_back(element);
      }
      (*joined)[root].observations.clear();
    }
    std::vector<Track> tracks;
    for (auto& [query, track] : track_of_query_point) {
      std::sort(track.observations.begin(), track.observations.end(), ComesBefore);
      tracks.push_back(std::move(track));
    }
    return tracks;
  }

  const std::vector<int>& frame_of_query_;
  const int num_queries_;
  std::unordered_map<uint64_t, int> nodes_;  // by image and keypoint
  std::vector<TrackObservation> points_;     // by node
  std::vector<int> parents_;                 // union-find, by node
  std::vector<int> num_database_links_;      // by node; nonzero for query keypoints only
  std::vector<int> num_own_tracks_;          // by query
  std::vector<std::pair<int, int>> links_;   // query keypoint, other keypoint
};

}  // namespace

std::vector<Track> BuildTracks(const PairRefs& pairs, const std::vector<int>& frame_of_query) {
  if (frame_of_query.size() == 1) return TracksOfOneQuery(pairs);
  const std::vector<std::vector<size_t>> unambiguous = UnambiguousMatches(pairs);
  MatchGraph graph(frame_of_query);
  for (size_t pair = 0; pair < pairs.size(); ++pair) graph.Add(*pairs[pair], unambiguous[pair]);
  return graph.Tracks();
}

}  // namespace lazyloc
