#include "colmap_lazyloc/io/query_files.h"

#include <array>
#include <cmath>
#include <string_view>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/io/text_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// `name MODEL width height params...`; none where the second word is no camera model: a name alone.
std::optional<QueryListEntry> ParseEntryWithCamera(const TextFile& file) {
  std::string_view rest = file.Line();
  const std::string name(NextWord(&rest));
  const std::optional<int> model_id = CameraModelId(std::string(NextWord(&rest)));
  if (!model_id) return std::nullopt;

  Camera camera;
  camera.model_id = *model_id;
  camera.width = file.ParseNumber<uint64_t>(NextWord(&rest));
  camera.height = file.ParseNumber<uint64_t>(NextWord(&rest));
  for (std::string_view word = NextWord(&rest); !word.empty(); word = NextWord(&rest)) {
    camera.params.push_back(file.ParseNumber<double>(word));
  }
  camera.has_prior_focal_length = true;
  if (const std::string problem = CameraProblem(camera); !problem.empty()) throw file.Error(problem);
  return QueryListEntry{name, camera};
}

// The other images of one query: a list for the order, a set against repetition.
struct Partners {
  std::vector<std::string> in_file_order;
  std::set<std::string> known;
};

void AddPartner(const std::string& name, Partners* partners) {
  if (partners->known.insert(name).second) partners->in_file_order.push_back(name);
}

}  // namespace

std::vector<QueryListEntry> ReadQueryList(const std::filesystem::path& path) {
  TextFile file(path);
  std::vector<QueryListEntry> entries;
  std::set<std::string> names;
  while (file.NextEntry()) {
    std::optional<QueryListEntry> entry = ParseEntryWithCamera(file);
    if (!entry) entry = QueryListEntry{std::string(file.Line()), std::nullopt};
    if (!names.insert(entry->name).second) throw file.Error("query '" + entry->name + "' is listed twice");
    entries.push_back(*std::move(entry));
  }
  if (entries.empty()) throw InputError(path.string() + ": lists no query");
  return entries;
}

QueryPairs ReadPairs(const std::filesystem::path& path, const std::set<std::string>& query_names,
                     const std::function<bool(const std::string&)>& is_known) {
  TextFile file(path);
  std::map<std::string, Partners> partners;
  QueryPairs pairs;
  bool has_pairs = false, has_known_names = false;
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    const std::string name1(NextWord(&rest)), name2(NextWord(&rest));
    if (name2.empty()) throw file.Error("expected two image names, found only '" + name1 + "'");
    has_pairs = true;
    const bool is_known1 = is_known(name1), is_known2 = is_known(name2);
    if (!is_known1) pairs.unknown_names.insert(name1);
    if (!is_known2) pairs.unknown_names.insert(name2);
    has_known_names = has_known_names || is_known1 || is_known2;
    if (name1 == name2) continue;  // retrieval tools list an image as its own neighbour
    if (is_known2 && query_names.count(name1) > 0) AddPartner(name2, &partners[name1]);
    if (is_known1 && query_names.count(name2) > 0) AddPartner(name1, &partners[name2]);
  }
  if (!has_pairs) throw InputError(path.string() + ": holds no pair");
  if (!has_known_names) {
    throw InputError(path.string() + ": the database has none of the images that it names, such as " +
                     *pairs.unknown_names.begin());
  }
  for (auto& [query_name, query_partners] : partners) {
    pairs.partners[query_name] = std::move(query_partners.in_file_order);
  }
  return pairs;
}

std::map<std::string, QueryPrior> ReadQueryPriors(const std::filesystem::path& path) {
  TextFile file(path);
  std::map<std::string, QueryPrior> priors;
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    std::array<double, 4> numbers{};  // the last four words
    for (size_t i = numbers.size(); i-- > 0;) {
      const size_t blank = rest.find_last_of(" \t");
      if (blank == std::string_view::npos) throw file.Error("expected `name x y z radius`");
      numbers[i] = file.ParseNumber<double>(rest.substr(blank + 1));
      if (!std::isfinite(numbers[i])) throw file.Error("a number is not finite");
      rest = Trimmed(rest.substr(0, blank));
    }
    if (numbers[3] <= 0) throw file.Error("the radius is not positive");
    const QueryPrior prior = {{numbers[0], numbers[1], numbers[2]}, numbers[3]};
    if (!priors.emplace(rest, prior).second) throw file.Error("query '" + std::string(rest) + "' is listed twice");
  }
  return priors;
}

}  // namespace lazyloc
