#include "colmap_lazyloc/loading/database_neighbours.h"

#include <algorithm>
#include <set>
#include <tuple>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {
namespace {

// Number of database images from which on the query's own tracks tell the size of the errors.
constexpr size_t kEnoughImages = 3;
// Maximum number of other images that an image is paired with, and of matches of a pair that are used.
constexpr size_t kMaxNumNeighbours = 6;
constexpr size_t kMaxNumMatches = 200;

int NumMatches(const ImagePair& pair) {
  return static_cast<int>(pair.geometry ? pair.geometry->inlier_matches.size() : pair.matches.size());
}

// Reads the matches of two images, evenly chosen ones if there are many. nullopt if they cannot be used. points: the
// keypoints of the first image.
std::optional<NeighbourPair> ReadNeighbour(const Model& model, uint32_t image_id,
                                           const std::vector<Eigen::Vector2d>& points, uint32_t other_id,
                                           const ModelImage& other, const DatabaseReader& database) {
  const std::optional<TwoViewGeometry> geometry = database.ReadTwoViewGeometry(image_id, other_id);
  if (!geometry || geometry->inlier_matches.empty()) return std::nullopt;
  const std::vector<Eigen::Vector2d> other_points = database.ReadKeypoints(other_id);
  NeighbourPair pair{model.cameras.at(other.camera_id), other.cam_from_world, {}, {}};
  const Matches& matches = geometry->inlier_matches;
  const size_t num = std::min(matches.size(), kMaxNumMatches);
  for (size_t i = 0; i < num; ++i) {
    const Match& match = matches[i * matches.size() / num];
    if (match.query_point >= points.size() || match.other_point >= other_points.size()) return std::nullopt;
    pair.points.push_back(points[match.query_point]);
    pair.other_points.push_back(other_points[match.other_point]);
  }
  return pair;
}

}  // namespace

std::vector<std::pair<uint32_t, const ModelImage*>> FindNeighbours(const QuerySelection& selection, uint32_t image_id,
                                                                   const std::string& query_name,
                                                                   const DatabaseReader& database) {
  std::vector<PairSize> sizes = database.ReadInlierCounts(image_id, selection.PosedImageIds());
  std::sort(sizes.begin(), sizes.end(), [](const PairSize& a, const PairSize& b) {
    return std::tie(b.num_matches, a.image_id) < std::tie(a.num_matches, b.image_id);
  });
  std::vector<std::pair<uint32_t, const ModelImage*>> neighbours;
  for (const PairSize& size : sizes) {
    const ModelImage* neighbour = selection.FindPosedImage(size.image_id, query_name);
    if (neighbour != nullptr && size.image_id != image_id) neighbours.emplace_back(size.image_id, neighbour);
    if (neighbours.size() == kMaxNumNeighbours) break;
  }
  return neighbours;
}

DatabaseNeighbours::DatabaseNeighbours(const QuerySelection& selection)
    : selection_(selection), cache_([](const std::vector<NeighbourPair>& pairs) {
        size_t num_points = 16;
        for (const NeighbourPair& pair : pairs) num_points += 16 + pair.points.size();
        return 2 * sizeof(Eigen::Vector2d) * num_points;
      }) {}

std::vector<NeighbourPair> DatabaseNeighbours::Read(const ModelImage& image, uint32_t image_id,
                                                    const std::string& query_name,
                                                    const DatabaseReader& database) const {
  const std::string frame_name = selection_.MakePair(image).database_frame_name;
  const std::vector<Eigen::Vector2d> points = database.ReadKeypoints(image_id);
  std::vector<NeighbourPair> pairs;
  for (const auto& [other_id, other] : FindNeighbours(selection_, image_id, query_name, database)) {
    // Leaves out images of the same rig frame, which share their error.
    if (!frame_name.empty() && selection_.MakePair(*other).database_frame_name == frame_name) continue;
    try {
      auto pair = ReadNeighbour(selection_.DatabaseModel(), image_id, points, other_id, *other, database);
      if (pair) pairs.push_back(*std::move(pair));
    } catch (const DamagedRecordError&) {
      continue;  // goes on without the pair, as for queries
    }
  }
  return pairs;
}

void DatabaseNeighbours::AddTo(const DatabaseReader& database, LoadedGroup* loaded) const {
  std::vector<std::set<std::string>> names(loaded->group.frame_names.size());
  for (const QueryImage& query : loaded->group.images) {
    for (const ImagePair& pair : query.problem.pairs) {
      if (NumMatches(pair) >= kMinNumInliers) names[query.frame].insert(pair.other_name);
    }
  }
  for (QueryImage& query : loaded->group.images) {
    if (names[query.frame].empty() || names[query.frame].size() >= kEnoughImages) continue;
    const StageTimer timer("database_pairs", &loaded->records[&query - loaded->group.images.data()].seconds);
    for (ImagePair& pair : query.problem.pairs) {
      if (NumMatches(pair) >= kMinNumInliers) pair.neighbours = Find(pair, query.problem.query_name, database);
    }
  }
}

std::vector<NeighbourPair> DatabaseNeighbours::Find(const ImagePair& pair, const std::string& query_name,
                                                    const DatabaseReader& database) const {
  const DatabaseImage* stored = selection_.FindInDatabase(pair.other_name);
  const ModelImage* image = stored == nullptr ? nullptr : selection_.FindPosedImage(stored->image_id, query_name);
  if (image == nullptr) return {};
  try {
    const auto read = [&] { return Read(*image, stored->image_id, query_name, database); };
    // A query that is itself a posed image takes no part, so that its neighbours are its own.
    return selection_.HasPosedQueries() ? read() : *cache_.Get(stored->image_id, read);
  } catch (const DamagedRecordError&) {
    return {};  // the list of the image's pairs is damaged
  }
}

}  // namespace lazyloc
