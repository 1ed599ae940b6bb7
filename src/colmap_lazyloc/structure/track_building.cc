#include "colmap_lazyloc/structure/track_building.h"

#include <algorithm>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace lazyloc {
namespace {

// A query with as many keypoints that stand alone needs no other query.
constexpr int kNumEnough = 100;

// How often each keypoint is matched within a pair. Flat, by keypoint: as large as the largest index asks for.
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

// The matches of each pair, by index, whose keypoints are matched once.
std::vector<std::vector<size_t>> UnambiguousMatches(const std::vector<ViewMatches>& view_matches) {
  std::vector<std::vector<size_t>> unambiguous(view_matches.size());
  UseCounter query, database;
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    const Matches& matches = view_matches[pair].matches;
    for (const Match& match : matches) {
      query.Add(match.query_point);
      database.Add(match.other_point);
    }
    unambiguous[pair].reserve(matches.size());
    for (size_t i = 0; i < matches.size(); ++i) {
      if (query[matches[i].query_point] == 1 && database[matches[i].other_point] == 1)
        unambiguous[pair].push_back(i);
    }
    for (const Match& match : matches) {
      query.Clear(match.query_point);
      database.Clear(match.other_point);
    }
  }
  return unambiguous;
}

// The tracks of the matches of one query.
std::vector<Track> TracksOfOneQuery(const std::vector<ViewMatches>& view_matches) {
  const std::vector<std::vector<size_t>> unambiguous = UnambiguousMatches(view_matches);
  std::vector<int> num_matches;  // of each query keypoint
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    for (const size_t i : unambiguous[pair]) {
      const uint32_t query_point = view_matches[pair].matches[i].query_point;
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
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    const ViewMatches& matches = view_matches[pair];
    for (const size_t i : unambiguous[pair]) {
      const Match& match = matches.matches[i];
      std::vector<TrackObservation>& observations = track_of_query_point[match.query_point]->observations;
      if (observations.empty()) {
        observations.push_back({0, static_cast<int>(match.query_point), matches.query_observations[i]});
      }
      observations.push_back({matches.view, static_cast<int>(match.other_point), matches.database_observations[i]});
    }
  }
  return tracks;
}

bool StandsBefore(const TrackObservation& a, const TrackObservation& b) {
  return std::tie(a.view, a.keypoint) < std::tie(b.view, b.keypoint);
}

// Image points, and the matches that join them.
class MatchGraph {
 public:
  explicit MatchGraph(const std::vector<int>& frame_of_query)
      : frame_of_query_(frame_of_query), num_queries_(static_cast<int>(frame_of_query.size())) {}

  void Add(const ViewMatches& pair, const std::vector<size_t>& match_indices) {
    for (const size_t i : match_indices) {
      const int query = Node(pair.query_view, pair.matches[i].query_point, pair.query_observations[i]);
      const int other = Node(pair.view, pair.matches[i].other_point, pair.database_observations[i]);
      links_.emplace_back(query, other);
      num_database_links_[query] += pair.view >= num_queries_;
    }
  }

  std::vector<Track> Tracks() {
    CountStandingAlone();
    links_.erase(std::remove_if(links_.begin(), links_.end(), [this](const auto& link) { return SaysLittle(link); }),
                 links_.end());
    for (const auto& [query, other] : links_) {
      if (!StandsAlone(query) && !StandsAlone(other)) parents_[Root(query)] = Root(other);
    }
    std::vector<Track> joined(points_.size());  // at their roots
    for (size_t node = 0; node < points_.size(); ++node) {
      if (!StandsAlone(static_cast<int>(node))) {
        joined[Root(static_cast<int>(node))].observations.push_back(points_[node]);
      }
    }
    std::vector<bool> is_contradictory(points_.size(), false);
    for (size_t root = 0; root < joined.size(); ++root) {
      std::vector<TrackObservation>& observations = joined[root].observations;
      std::sort(observations.begin(), observations.end(), StandsBefore);
      is_contradictory[root] =
          std::adjacent_find(observations.begin(), observations.end(),
                             [](const auto& a, const auto& b) { return a.view == b.view; }) != observations.end();
    }
    std::vector<Track> tracks = TracksOfSingleQueries(is_contradictory, &joined);
    for (size_t root = 0; root < joined.size(); ++root) {
      const std::vector<TrackObservation>& observations = joined[root].observations;
      const bool is_track = observations.size() >= 2 && observations.front().view < num_queries_;
      if (is_track && !is_contradictory[root]) tracks.push_back(std::move(joined[root]));
    }
    std::sort(tracks.begin(), tracks.end(), [](const Track& a, const Track& b) {
      return StandsBefore(a.observations.front(), b.observations.front());
    });
    return tracks;
  }

 private:
  int Node(int view, uint32_t keypoint, const Observation& observation) {
    const auto [node, is_new] =
        nodes_.emplace(static_cast<uint64_t>(view) << 32 | keypoint, static_cast<int>(points_.size()));
    if (is_new) {
      points_.push_back({view, static_cast<int>(keypoint), observation});
      parents_.push_back(node->second);
      num_database_links_.push_back(0);
    }
    return node->second;
  }

  bool StandsAlone(int node) const { return num_database_links_[node] >= 2; }

  void CountStandingAlone() {
    num_standing_alone_.assign(num_queries_, 0);
    for (size_t node = 0; node < points_.size(); ++node) {
      if (StandsAlone(static_cast<int>(node))) ++num_standing_alone_[points_[node].view];
    }
  }

  bool HasEnough(int node) const { return num_standing_alone_[points_[node].view] >= kNumEnough; }

  // Between queries of different frames, each of which has enough without the other.
  bool SaysLittle(const std::pair<int, int>& link) const {
    const int view1 = points_[link.first].view, view2 = points_[link.second].view;
    return view2 < num_queries_ && frame_of_query_[view1] != frame_of_query_[view2] && HasEnough(link.first) &&
           HasEnough(link.second);
  }

  int Root(int node) {
    while (parents_[node] != node) node = parents_[node] = parents_[parents_[node]];
    return node;
  }

  // Of the query keypoints that stand alone or are in contradictory tracks, with the database keypoints that they are
  // matched with; each joined track of a query that has few of the former goes with the first of them
  // that it is matched with.
  std::vector<Track> TracksOfSingleQueries(const std::vector<bool>& is_contradictory, std::vector<Track>* joined) {
    std::unordered_map<int, Track> track_of_query_point;
    for (const auto& [query, other] : links_) {
      if (!(StandsAlone(query) || is_contradictory[Root(query)]) || points_[other].view < num_queries_) continue;
      Track& track = track_of_query_point[query];
      if (track.observations.empty()) track.observations.push_back(points_[query]);
      track.observations.push_back(points_[other]);
    }
    for (const auto& [query, other] : links_) {
      if (points_[other].view >= num_queries_ || StandsAlone(query) == StandsAlone(other)) continue;
      const int weak = StandsAlone(query) ? other : query, root = Root(weak);
      if (is_contradictory[root] || HasEnough(weak)) continue;
      Track& track = track_of_query_point[StandsAlone(query) ? query : other];
      for (const TrackObservation& element : (*joined)[root].observations) {
        const bool is_new = std::none_of(track.observations.begin(), track.observations.end(),
                                         [&](const TrackObservation& own) { return own.view == element.view; });
        if (is_new) track.observations.push_back(element);
      }
      (*joined)[root].observations.clear();
    }
    std::vector<Track> tracks;
    for (auto& [query, track] : track_of_query_point) {
      std::sort(track.observations.begin(), track.observations.end(), StandsBefore);
      tracks.push_back(std::move(track));
    }
    return tracks;
  }

  const std::vector<int>& frame_of_query_;
  const int num_queries_;
  std::unordered_map<uint64_t, int> nodes_;  // by view and keypoint
  std::vector<TrackObservation> points_;     // of the nodes
  std::vector<int> parents_;                 // union-find
  std::vector<int> num_database_links_;      // of query keypoints
  std::vector<int> num_standing_alone_;      // keypoints of each query
  std::vector<std::pair<int, int>> links_;   // query keypoint, other keypoint
};

}  // namespace

std::vector<Track> BuildTracks(const std::vector<ViewMatches>& view_matches, const std::vector<int>& frame_of_query) {
  if (frame_of_query.size() == 1) return TracksOfOneQuery(view_matches);  // what the graph gives, faster
  const std::vector<std::vector<size_t>> unambiguous = UnambiguousMatches(view_matches);
  MatchGraph graph(frame_of_query);
  for (size_t pair = 0; pair < view_matches.size(); ++pair) graph.Add(view_matches[pair], unambiguous[pair]);
  return graph.Tracks();
}

}  // namespace lazyloc
