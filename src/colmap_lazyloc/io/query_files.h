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
  std::optional<Camera> camera;  // hloc's form only
};

// A query list: one name a line, or hloc's `name MODEL width height params...`. Empty lines and lines that
// start with '#' are skipped. A name alone may hold spaces: a line is of hloc's form if its second word is a camera
// model that COLMAP knows. Throws InputError, `file:line: ...`, for a missing or empty list, a duplicate name, a wrong
// number of parameters, or numbers that cannot be.
std::vector<QueryListEntry> ReadQueryList(const std::filesystem::path& path);

struct QueryPairs {
  // For each query that appears on either side of a line, the other names: without repetition, in file order.
  std::map<std::string, std::vector<std::string>> partners;
  std::set<std::string> unknown_names;  // left out above
};

// Pairs of names, hloc's and COLMAP's format: two names a line, further words (a score) ignored, '#' comments.
// is_known: whether the database has an image of that name.
// Throws InputError, `file:line: ...`, for a missing file, one without pairs or without any known name, or a line with
// fewer than two names.
QueryPairs ReadPairs(const std::filesystem::path& path, const std::set<std::string>& query_names,
                     const std::function<bool(const std::string&)>& is_known);

// Where a query was roughly taken: its position is within the radius, in the model's coordinates and unit.
struct QueryPrior {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double radius = 0;
};

// `name x y z radius` a line, where a name may hold blanks; '#' comments. By name. Throws InputError, `file:line: ...`,
// for a missing file, a name that appears twice, or numbers that cannot be.
std::map<std::string, QueryPrior> ReadQueryPriors(const std::filesystem::path& path);

}  // namespace lazyloc
