#include "colmap_lazyloc/io/query_files.h"

#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Parses `name MODEL width height params...`. Returns nullopt if the second word is not a camera model, because the
// line is a name alone.
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
  if (entries.empty()) throw InputError(path.string() + ": contains no query");
  return entries;
}

QueryPairs ReadPairs(const std::filesystem::path& path, const std::set<std::string>& query_names,
                     const std::function<bool(const std::string&)>& is_known) {
  TextFile file(path);
  QueryPairs pairs;
  std::set<std::pair<std::string, std::string>> known_pairs;
  const auto add = [&](const std::string& query_name, const std::string& other_name) {
    const bool is_new = known_pairs.emplace(query_name, other_name).second;
    if (is_new) pairs.other_names[query_name].push_back(other_name);
  };
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
    if (is_known2 && query_names.count(name1) > 0) add(name1, name2);
    if (is_known1 && query_names.count(name2) > 0) add(name2, name1);
  }
  if (!has_pairs) throw InputError(path.string() + ": contains no pair");
  if (!has_known_names) {
    throw InputError(path.string() + ": none of its images is in the database (for example " +
                     *pairs.unknown_names.begin() + ")");
  }
  return pairs;
}

std::map<std::string, SearchRegion> ReadSearchRegions(const std::filesystem::path& path) {
  TextFile file(path);
  std::map<std::string, SearchRegion> priors;
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    std::array<double, 4> numbers{};  // the last four words, because a name may hold spaces
    for (size_t i = numbers.size(); i-- > 0;) {
      const size_t blank = rest.find_last_of(" \t");
      if (blank == std::string_view::npos) throw file.Error("expected `name x y z radius`");
      numbers[i] = file.ParseNumber<double>(rest.substr(blank + 1));
      if (!std::isfinite(numbers[i])) throw file.Error("a number is not finite");
      rest = Trimmed(rest.substr(0, blank));
    }
    if (numbers[3] <= 0) throw file.Error("the radius is not positive");
    const SearchRegion prior = {{numbers[0], numbers[1], numbers[2]}, numbers[3]};
    if (!priors.emplace(rest, prior).second) throw file.Error("query '" + std::string(rest) + "' is listed twice");
  }
  return priors;
}

}  // namespace lazyloc
