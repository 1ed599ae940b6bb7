#include "colmap_lazyloc/formats/query_files.h"

#include <string_view>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/model_reader.h"
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

  Camera camera = ParseCamera(*model_id, rest, file);
  camera.has_prior_focal_length = true;
  if (const std::string problem = CameraProblem(camera); !problem.empty()) throw file.Error(problem);
  return QueryListEntry{name, camera};
}

}  // namespace

void ReadQueryList(const std::filesystem::path& path, const std::function<bool(QueryListEntry)>& add) {
  TextFile file(path);
  bool is_empty = true;
  while (file.NextEntry()) {
    std::optional<QueryListEntry> entry = ParseEntryWithCamera(file);
    if (!entry) entry = QueryListEntry{std::string(file.Line()), std::nullopt};
    const std::string name = entry->name;
    if (!add(*std::move(entry))) throw file.Error("query '" + name + "' is listed twice");
    is_empty = false;
  }
  if (is_empty) throw InputError(path.string() + ": contains no query");
}

void ReadPairs(const std::filesystem::path& path,
               const std::function<void(const std::string&, const std::string&)>& add) {
  TextFile file(path);
  bool is_empty = true;
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    const std::string name1(NextWord(&rest)), name2(NextWord(&rest));
    if (name2.empty()) throw file.Error("expected two image names, found only '" + name1 + "'");
    add(name1, name2);
    is_empty = false;
  }
  if (is_empty) throw InputError(path.string() + ": contains no pair");
}

}  // namespace lazyloc
