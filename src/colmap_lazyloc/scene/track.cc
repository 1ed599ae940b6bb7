#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

bool HasSeveralDatabaseFrames(const PosedImages& posed, const std::vector<TrackObservation>& observations) {
  int first = -1;
  for (const TrackObservation& element : observations) {
    if (!posed.IsDatabase(element.image)) continue;
    const int frame = posed.images[element.image].frame;
    if (first >= 0 && frame != first) return true;
    first = frame;
  }
  return false;
}

}  // namespace lazyloc
