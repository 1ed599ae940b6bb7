#include "colmap_lazyloc/loading/pair_loader.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// True if a geometry estimated with one camera holds for the other: they differ at most by the rounding of a text file.
bool AgreeOnIntrinsics(const Camera& a, const Camera& b) {
  if (a.model_id != b.model_id || a.params.size() != b.params.size()) return false;
  for (size_t i = 0; i < a.params.size(); ++i) {
    if (std::abs(a.params[i] - b.params[i]) > 1e-6 * (1e-3 + std::abs(a.params[i]))) return false;
  }
  return true;
}

// Reads matches, geometry and the other image's keypoints into a pair. other_id: the other image's id in the database;
// other_stored_camera: its camera there. Returns false if there are no matches, or verification left none. Throws
// DamagedRecordError, also if a match names a keypoint that its image does not have.
bool ReadPair(const LocalizationProblem& problem, const StoredQuery& query, uint32_t other_id,
              const Camera& other_stored_camera, const DatabaseReader& database, ImagePair* pair) {
  const uint32_t query_id = query.image.image_id;
  pair->geometry = database.ReadTwoViewGeometry(query_id, other_id);
  if (!pair->geometry) pair->matches = database.ReadMatches(query_id, other_id);
  const Matches& matches = pair->geometry ? pair->geometry->inlier_matches : pair->matches;
  if (matches.empty()) return false;
  pair->other_keypoints = database.ReadKeypoints(other_id);
  if (pair->geometry &&
      (!AgreeOnIntrinsics(pair->geometry->query_camera.value_or(query.stored_camera), query.camera) ||
       !AgreeOnIntrinsics(pair->geometry->other_camera.value_or(other_stored_camera), pair->other_camera))) {
    ForgetIntrinsics(&*pair->geometry);
  }
  const std::string table = pair->geometry ? "two_view_geometries" : "matches";
  for (const Match& match : matches) {
    if (match.query_point >= problem.query_keypoints.size() || match.other_point >= pair->other_keypoints.size()) {
      throw DamagedRecordError(database.Path().string(),
                               AsOneLine("table " + table + ", pair of " + problem.query_name + " and " +
                                         pair->other_name + ": a match names a keypoint that its image does not have"));
    }
  }
  return true;
}

}  // namespace

void PairLoader::LoadPairs(const StoredQuery& query, const std::vector<PairSize>& sizes, size_t max_num_pairs,
                           const DatabaseReader& database, LocalizationProblem* problem,
                           std::vector<std::string>* damages) const {
  using Candidate = std::pair<const ModelImage*, int>;
  std::vector<Candidate> candidates;  // with the number of matches
  for (const PairSize& size : sizes) {
    const ModelImage* image = selection_.FindPosedImage(size.image_id, query.image.name);
    if (image != nullptr) candidates.emplace_back(image, size.num_matches);
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(b.second, a.first->name) < std::tie(a.second, b.first->name);
  });
  for (const auto& [image, num_matches] : candidates) {
    if (problem->pairs.size() == max_num_pairs) return;
    const DatabaseImage& stored = *selection_.FindInDatabase(image->name);
    ImagePair pair = selection_.MakePair(*image);
    try {
      const Camera stored_camera = database.ReadCamera(stored.camera_id);
      if (!ReadPair(*problem, query, stored.image_id, stored_camera, database, &pair)) continue;
      problem->pairs.push_back(std::move(pair));
    } catch (const DamagedRecordError& error) {
      damages->push_back(error.Damage());
    }
  }
}

LocalizationProblem PairLoader::Load(const StoredQuery& query, int num_retrieved, const DatabaseReader& database,
                                     std::vector<std::string>* damages) const {
  const auto max_num_verified = static_cast<size_t>(num_retrieved);
  LocalizationProblem problem;
  problem.query_name = query.image.name;
  problem.query_camera = query.camera;
  problem.intrinsics_origin = query.intrinsics_origin;
  problem.query_keypoints = database.ReadKeypointsOnce(query.image.image_id);
  if (problem.query_keypoints.empty()) return problem;
  const auto load = [&](const std::vector<PairSize>& sizes, size_t max_num_pairs) {
    LoadPairs(query, sizes, max_num_pairs, database, &problem, damages);
  };
  if (const auto listed_ids = selection_.ListedPairs(query)) {
    std::vector<PairSize> listed;
    for (const uint32_t image_id : *listed_ids) listed.push_back({image_id, 0});
    load(listed, listed.size());
  } else {
    const std::vector<PairSize> verified = database.ReadInlierCounts(query.image.image_id, selection_.PosedImageIds());
    load(verified, max_num_verified);
    if (problem.pairs.size() < max_num_verified) {
      const std::vector<PairSize> raw = database.ReadMatchCounts(query.image.image_id, selection_.PosedImageIds());
      std::vector<PairSize> unverified;
      std::set_difference(raw.begin(), raw.end(), verified.begin(), verified.end(), std::back_inserter(unverified),
                          [](const PairSize& a, const PairSize& b) { return a.image_id < b.image_id; });
      load(unverified, problem.pairs.size() + 2 * max_num_verified);
    }
  }
  std::sort(problem.pairs.begin(), problem.pairs.end(),
            [](const ImagePair& a, const ImagePair& b) { return a.other_name < b.other_name; });
  return problem;
}

void PairLoader::LoadPairsWithQueries(int query_index, const std::map<uint32_t, int>& earlier_queries,
                                      const DatabaseReader& database, LoadedGroup* loaded) const {
  QueryGroup& group = loaded->group;
  const LocalizationProblem& problem = group.images[query_index].problem;
  const StoredQuery query = selection_.ReadStoredQuery(problem.query_name, database);
  std::set<int> others;
  if (const auto listed_ids = selection_.ListedPairs(query)) {
    for (const auto& [image_id, index] : earlier_queries) {
      if (std::binary_search(listed_ids->begin(), listed_ids->end(), image_id)) others.insert(index);
    }
  } else {
    std::vector<uint32_t> earlier_ids;
    for (const auto& [image_id, index] : earlier_queries) earlier_ids.push_back(image_id);
    const uint32_t query_id = query.image.image_id;
    for (const auto& sizes :
         {database.ReadInlierCounts(query_id, earlier_ids), database.ReadMatchCounts(query_id, earlier_ids)}) {
      for (const PairSize& size : sizes) others.insert(earlier_queries.at(size.image_id));
    }
  }
  for (const int other_index : others) {
    try {
      const StoredQuery other = selection_.ReadStoredQuery(group.images[other_index].problem.query_name, database);
      ImagePair pair;
      pair.other_name = other.image.name;
      pair.other_camera = other.camera;
      if (!ReadPair(problem, query, other.image.image_id, other.stored_camera, database, &pair)) continue;
      group.query_pairs.push_back({query_index, other_index, std::move(pair)});
    } catch (const DamagedRecordError& error) {
      loaded->records[query_index].damages.push_back(error.Damage());
    }
  }
}

void PairLoader::LoadQueryPairs(const DatabaseReader& database, LoadedGroup* loaded) const {
  const std::vector<QueryImage>& images = loaded->group.images;
  if (images.size() < 2) return;
  std::map<uint32_t, int> earlier_queries;  // by id in the database
  for (int query_index = 0; query_index < static_cast<int>(images.size()); ++query_index) {
    const LocalizationProblem& problem = images[query_index].problem;
    const bool is_from_files = loaded->records[query_index].intrinsics_source.has_value();  // not given by the caller
    const std::optional<uint32_t> image_id =
        is_from_files ? selection_.FindStoredQuery(problem.query_name) : std::nullopt;
    // Skips photos, and queries without keypoints, because their matches name keypoints that do not exist.
    if (!image_id || problem.query_keypoints.empty()) continue;
    try {
      LoadPairsWithQueries(query_index, earlier_queries, database, loaded);
    } catch (const DamagedRecordError& error) {  // of the list of its pairs
      loaded->records[query_index].damages.push_back(error.Damage());
    }
    earlier_queries.emplace(*image_id, query_index);
  }
}

}  // namespace lazyloc
