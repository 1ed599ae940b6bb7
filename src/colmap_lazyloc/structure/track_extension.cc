#include "colmap_lazyloc/structure/track_extension.h"

#include <algorithm>
#include <map>
#include <unordered_map>

namespace lazyloc {
namespace {

uint64_t Key(int view, uint32_t keypoint) { return static_cast<uint64_t>(view) << 32 | keypoint; }

// Of one track: the keypoint that matches propose in a view that it does not have; none where they disagree.
using Proposals = std::map<int, std::optional<uint32_t>>;

void Propose(int view, uint32_t keypoint, const Track& track, Proposals* proposals) {
  const bool has_view = std::any_of(track.observations.begin(), track.observations.end(),
                                    [&](const TrackObservation& element) { return element.view == view; });
  if (has_view) return;
  const auto [proposal, is_new] = proposals->try_emplace(view, keypoint);
  if (!is_new && proposal->second != keypoint) proposal->second.reset();
}

}  // namespace

void ExtendTracks(const std::vector<DatabaseViewMatches>& matches, const ObserveKeypoint& observe,
                  std::vector<Track>* tracks) {
  // Several query keypoints may share a database keypoint.
  std::unordered_multimap<uint64_t, size_t> tracks_of_keypoint;
  for (size_t track = 0; track < tracks->size(); ++track) {
    for (const TrackObservation& element : (*tracks)[track].observations) {
      tracks_of_keypoint.emplace(Key(element.view, element.keypoint), track);
    }
  }
  std::vector<Proposals> proposals(tracks->size());
  const auto propose = [&](uint64_t known, int view, uint32_t keypoint) {
    const auto [begin, end] = tracks_of_keypoint.equal_range(known);
    for (auto it = begin; it != end; ++it) Propose(view, keypoint, (*tracks)[it->second], &proposals[it->second]);
  };
  for (const DatabaseViewMatches& pair : matches) {
    for (const auto& [keypoint1, keypoint2] : *pair.keypoints) {
      propose(Key(pair.view1, keypoint1), pair.view2, keypoint2);
      propose(Key(pair.view2, keypoint2), pair.view1, keypoint1);
    }
  }
  for (size_t track = 0; track < tracks->size(); ++track) {
    std::vector<TrackObservation>& observations = (*tracks)[track].observations;
    for (const auto& [view, keypoint] : proposals[track]) {
      if (!keypoint) continue;
      const std::optional<Observation> observation = observe(view, *keypoint);
      if (observation) observations.push_back({view, static_cast<int>(*keypoint), *observation});
    }
    std::sort(observations.begin(), observations.end(),
              [](const TrackObservation& a, const TrackObservation& b) { return a.view < b.view; });
  }
}

}  // namespace lazyloc
