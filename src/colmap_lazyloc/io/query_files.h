#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

struct QueryListEntry {
  std::string name;
  std::optional<Camera> camera;  // only in hloc's format
};

// Reads a query list: one name a line, or hloc's `name MODEL width height params...`. Skips empty lines and comments
// (first character '#'). A name may hold spaces, unless the line is in hloc's format, which is one whose second word is
// a camera model of COLMAP. Throws InputError, `file:line: ...`, for a missing or empty list, a name that is listed
// twice, a wrong number of parameters, or impossible numbers.
std::vector<QueryListEntry> ReadQueryList(const std::filesystem::path& path);

struct QueryPairs {
  // Lists for each query the names on the other side of its lines, each once, in the order of the file.
  std::map<std::string, std::vector<std::string>> other_names;
  std::set<std::string> unknown_names;  // left out of other_names
};

// Reads pairs of names in hloc's and COLMAP's format: two names a line, further words (for example a score) ignored,
// '#' comments. is_known: returns true for the names that pairs may use. Throws InputError, `file:line: ...`, for a
// missing file, a file without pairs or without known names, or a line with fewer than two names.
QueryPairs ReadPairs(const std::filesystem::path& path, const std::set<std::string>& query_names,
                     const std::function<bool(const std::string&)>& is_known);

// A sphere that a query was taken in, in the model's coordinates and unit.
struct SearchRegion {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double radius = 0;
};

// Reads lines `name x y z radius`, whose name may hold spaces, and '#' comments. Returns the priors by name. Throws
// InputError, `file:line: ...`, for a missing file, a name that is listed twice, or impossible numbers.
std::map<std::string, SearchRegion> ReadSearchRegions(const std::filesystem::path& path);

}  // namespace lazyloc
