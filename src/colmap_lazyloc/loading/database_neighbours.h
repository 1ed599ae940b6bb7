#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/loading/loaded_group.h"
#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// What database images tell together with others: each is paired with the six posed images that it shares most verified
// matches with, because more would tell little. A query and the images of its group take no part. Damaged records are
// left out. Thread-safe with one reader per thread.
class DatabaseNeighbours {
 public:
  // The selection must outlive this.
  explicit DatabaseNeighbours(const QuerySelection& selection);

  // Returns verified pairs of a posed image with others, which the database has no matches for.
  using MatchFunction = std::function<std::vector<ImagePair>(const ModelImage& image, int max_num_others)>;

  // Adds the pairs of the database images, which show how wrong database poses are, to query frames with less than
  // three database images, because more show it by themselves. match_now: for photos, if the database has no matches
  // of a database image; may be null.
  void AddTo(const DatabaseReader& database, const MatchFunction& match_now, LoadedGroup* loaded) const;
  // Returns the depths of the points that a database image triangulates with its neighbours, at its keypoints, for
  // comparison with its depth map; 0 where there is none.
  std::vector<float> PointDepths(const std::string& image_name, const std::string& query_name,
                                 const DatabaseReader& database) const;

 private:
  using VisitNeighbour = std::function<void(const ModelImage& other, const Matches& matches,
                                            const std::vector<Eigen::Vector2d>& other_points)>;
  void ForEachNeighbour(uint32_t image_id, const std::string& query_name, const DatabaseReader& database,
                        const VisitNeighbour& visit) const;
  std::vector<NeighbourPair> Read(const ModelImage& image, uint32_t image_id, const std::string& query_name,
                                  const DatabaseReader& database) const;
  // Returns the pair of an image and one of its neighbours; nullopt if both are of one rig frame, and share their
  // error.
  std::optional<NeighbourPair> MakeNeighbourPair(const ModelImage& image, const std::vector<Eigen::Vector2d>& points,
                                                 const ModelImage& other, const Matches& matches,
                                                 const std::vector<Eigen::Vector2d>& other_points) const;
  std::vector<NeighbourPair> MatchNow(const ModelImage& image, const DatabaseReader& database,
                                      const MatchFunction& match_now, uint32_t image_id) const;
  std::vector<float> Triangulate(const ModelImage& image, uint32_t image_id, const std::string& query_name,
                                 const DatabaseReader& database) const;
  // Returns what `find` finds for a database image, which is kept unless a query may have a part in it; nothing for an
  // image without a pose, or whose list of pairs is damaged.
  template <typename Value, typename Find>
  std::vector<Value> FindOnce(const std::string& image_name, const std::string& query_name,
                              const DatabaseReader& database, LruCache<std::vector<Value>>* cache, Find find) const;

  const QuerySelection& selection_;
  mutable LruCache<std::vector<NeighbourPair>> pairs_, matched_pairs_;
  mutable LruCache<std::vector<float>> depths_;
};

}  // namespace lazyloc
