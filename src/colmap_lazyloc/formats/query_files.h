#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

struct QueryListEntry {
  std::string name;
  std::optional<Camera> camera;  // only in hloc's format
};

// Reads a query list: one name a line, or hloc's `name MODEL width height params...`. Skips empty lines and comments
// (first character '#'). A name may hold spaces, unless the line is in hloc's format, which is one whose second word is
// a camera model of COLMAP. Throws InputError, `file:line: ...`, for a missing or empty list, a name that is listed
// twice, a wrong number of parameters, impossible numbers, or numbers after a word that is not a camera model.
// add: takes the entries one by one, because there may be millions; returns false if it has had the name before.
void ReadQueryList(const std::filesystem::path& path, const std::function<bool(QueryListEntry)>& add);

// Reads pairs of names in hloc's and COLMAP's format: two names a line, further words (for example a score) ignored,
// '#' comments. Throws InputError, `file:line: ...`, for a missing file, a file without pairs, or a line with fewer
// than two names. add: takes the pairs one by one, because there may be millions.
void ReadPairs(const std::filesystem::path& path,
               const std::function<void(const std::string&, const std::string&)>& add);

}  // namespace lazyloc
