#include "colmap_lazyloc/structure/track_selection.h"

#include <algorithm>
#include <numeric>

namespace lazyloc {
namespace {

constexpr int kNumCells = 8;  // along each side of the image

// Returns the cell of each track in a grid over the tracks' keypoints.
std::vector<int> CellsOf(const std::vector<Track>& tracks, const std::vector<Eigen::Vector2d>& keypoints) {
  std::vector<Eigen::Array2d> positions;
  for (const Track& track : tracks) positions.push_back(keypoints[track.observations.front().keypoint]);
  Eigen::Array2d smallest = positions.front(), largest = positions.front();
  for (const Eigen::Array2d& position : positions) {
    smallest = smallest.min(position);
    largest = largest.max(position);
  }
  const Eigen::Array2d cell_size = (largest - smallest) / kNumCells + 1e-9;
  std::vector<int> cells;
  for (const Eigen::Array2d& position : positions) {
    const Eigen::Array2i cell = ((position - smallest) / cell_size).cast<int>();
    cells.push_back(cell.x() + kNumCells * cell.y());
  }
  return cells;
}

}  // namespace

std::vector<Track> SelectTracks(const std::vector<Track>& tracks, const std::vector<Eigen::Vector2d>& keypoints,
                                int max_num_tracks) {
  if (static_cast<int>(tracks.size()) <= max_num_tracks) return tracks;
  std::vector<size_t> order(tracks.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return tracks[a].observations.size() > tracks[b].observations.size(); });
  // Takes each track in the turn of its rank within its cell.
  const std::vector<int> cells = CellsOf(tracks, keypoints);
  std::vector<int> num_in_cell(kNumCells * kNumCells, 0), turn(tracks.size());
  for (const size_t track : order) turn[track] = num_in_cell[cells[track]]++;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return turn[a] < turn[b]; });
  order.resize(max_num_tracks);
  std::sort(order.begin(), order.end());
  std::vector<Track> selected;
  for (const size_t track : order) selected.push_back(tracks[track]);
  return selected;
}

}  // namespace lazyloc
