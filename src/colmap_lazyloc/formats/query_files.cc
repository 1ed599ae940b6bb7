#include "colmap_lazyloc/formats/query_files.h"

#include <string_view>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// True if `rest` can be what follows a camera model: at least four numbers, up to the end of the line.
bool IsLikeIntrinsics(std::string_view rest) {
  int num_numbers = 0;
  for (std::string_view word = NextWord(&rest); !word.empty(); word = NextWord(&rest)) {
    if (!NumberFrom<double>(word)) return false;
    ++num_numbers;
  }
  return num_numbers >= 4;
}

// Parses `name MODEL width height params...`, or a name alone if the second word is not a camera model.
QueryListEntry ParseEntry(const TextFile& file) {
  std::string_view rest = file.Line();
  const std::string name(NextWord(&rest)), model_name(NextWord(&rest));
  const std::optional<int> model_id = CameraModelId(model_name);
  if (!model_id && !NumberFrom<double>(model_name) && IsLikeIntrinsics(rest)) {
    throw file.Error("unknown camera model '" + model_name + "' (expected: name MODEL width height params...)");
  }
  if (!model_id) return {std::string(file.Line()), std::nullopt};

  Camera camera = ParseCamera(*model_id, rest, file);
  camera.has_prior_focal_length = true;
  if (const std::string problem = CameraProblem(camera); !problem.empty()) throw file.Error(problem);
  return {name, camera};
}

}  // namespace

void ReadQueryList(const std::filesystem::path& path, const std::function<bool(QueryListEntry)>& add) {
  TextFile file(path);
  if (!file.NextEntry()) throw InputError(path.string() + ": contains no query");
  do {
    const QueryListEntry entry = ParseEntry(file);
    if (!add(entry)) throw file.Error("query '" + entry.name + "' is listed twice");
  } while (file.NextEntry());
}

void ReadPairs(const std::filesystem::path& path,
               const std::function<void(const std::string&, const std::string&)>& add) {
  TextFile file(path);
  if (!file.NextEntry()) throw InputError(path.string() + ": contains no pair");
  do {
    std::string_view rest = file.Line();
    const std::string name1(NextWord(&rest)), name2(NextWord(&rest));
    if (name2.empty()) throw file.Error("expected two image names, found only '" + name1 + "'");
    add(name1, name2);
  } while (file.NextEntry());
}

}  // namespace lazyloc
