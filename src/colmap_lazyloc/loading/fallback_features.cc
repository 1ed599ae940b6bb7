#include "colmap_lazyloc/loading/fallback_features.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/features/mutual_neighbours.h"
#include "colmap_lazyloc/features/pair_matching.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Number of database images that a photo is matched with, because LightGlue takes seconds for each.
constexpr size_t kMaxNumImages = 5;
// The features of a database image, and how alike it looks.
struct Rated {
  size_t num_neighbours = 0;
  const DatabaseCandidate* candidate = nullptr;
  std::shared_ptr<const Features> features;
};

// Returns the images that look most like the query, sorted by name. features: of the candidates, null for those that
// cannot be used.
std::vector<Rated> ChooseBest(const Features& query, const DatabaseCandidates& candidates,
                              const DatabaseFeatures& features, IdleThreads* idle_threads) {
  std::vector<Rated> rated(candidates.size());
  ParallelFor(
      candidates.size(),
      [&](size_t i) {
        const size_t num_neighbours = features[i] ? CountMutualNeighbours(query, *features[i]) : 0;
        rated[i] = {num_neighbours, candidates[i], features[i]};
      },
      idle_threads);
  rated.erase(std::remove_if(rated.begin(), rated.end(), [](const Rated& image) { return !image.features; }),
              rated.end());
  std::stable_sort(rated.begin(), rated.end(),
                   [](const Rated& a, const Rated& b) { return a.num_neighbours > b.num_neighbours; });
  rated.resize(std::min(rated.size(), kMaxNumImages));
  std::sort(rated.begin(), rated.end(),
            [](const Rated& a, const Rated& b) { return a.candidate->image->name < b.candidate->image->name; });
  return rated;
}

size_t NumBytes(const std::optional<Features>& features) {
  return features ? features->keypoints.size() * sizeof(Keypoint) + static_cast<size_t>(features->descriptors.size())
                  : 0;
}

}  // namespace

FallbackFeatures::FallbackFeatures(const QuerySelection& selection, const PhotoOptions& options,
                                   const FeatureMethod& method, FeatureType database_type, int seed)
    : selection_(selection), seed_(seed), method_(method), features_(NumBytes, options.CacheBytes()) {
  if (method.Type() == database_type) return;
  const std::string& index_path = options.retrieval_index_path;
  extracted_.emplace(method, options.image_path, index_path.empty() ? "" : index_path + ".aliked");
}

DatabaseFeatures FallbackFeatures::ReadFeatures(const DatabaseCandidates& candidates, const FeatureReader& reader,
                                                IdleThreads* idle_threads) const {
  const Model& model = selection_.DatabaseModel();
  const auto read = [&](const DatabaseCandidate& candidate) -> std::optional<Features> {
    if (extracted_) return extracted_->Get(candidate.image->name, model.cameras.at(candidate.image->camera_id));
    try {
      return reader.Read(candidate.image_id);
    } catch (const DamagedRecordError&) {
      return std::nullopt;  // the first attempt has reported it
    }
  };
  DatabaseFeatures features(candidates.size());
  IdleThreads none(0);  // help with files, but not with the one connection to the database
  ParallelFor(
      candidates.size(),
      [&](size_t i) {
        const auto kept = features_.Get(candidates[i]->image_id, [&] { return read(*candidates[i]); });
        if (*kept) features[i] = std::shared_ptr<const Features>(kept, &**kept);
      },
      extracted_ ? idle_threads : &none);
  return features;
}

LocalizationProblem FallbackFeatures::Load(const PhotoFile& photo, const LocalizationProblem& first,
                                           const DatabaseCandidates& candidates, const FeatureReader& reader,
                                           IdleThreads* idle_threads, QueryRecord* record) const {
  LocalizationProblem problem = first;
  problem.pairs.clear();
  Features features;
  std::vector<Rated> best;
  {
    const StageTimer timer("extraction", &record->seconds);
    features = method_.Extract(photo, MeanFocalLength(problem.query_camera), idle_threads);
    best = ChooseBest(features, candidates, ReadFeatures(candidates, reader, idle_threads), idle_threads);
  }
  problem.query_keypoints = record->keypoints = Positions(features.keypoints);
  record->matcher = method_.Matcher();
  DatabaseFeatures database_features;
  for (Rated& image : best) {
    problem.pairs.push_back(selection_.MakePair(*image.candidate->image));
    database_features.push_back(std::move(image.features));
  }
  MatchPairs(method_, features, database_features, {seed_}, idle_threads, &problem, &record->seconds);
  return problem;
}

}  // namespace lazyloc
