#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/query_prior.h"

namespace lazyloc {

struct QueryPriorOptions {
  std::string position_path, gravity_path;  // empty: no such priors
  std::string world_up;                     // x,y,z: the direction against gravity in the world; empty if unknown

  bool Check(std::string* error) const;
};

// Reads the files of what is known of the queries' poses beside their matches, in lines
//   name x y z stddev                or  name x y z sx sy sz  or  name x y z xx xy xz yy yz zz (a covariance)
//   name gx gy gz stddev_deg
// and '#' comments. A name may hold spaces. is_query: returns true for the names that lines may have. Throws
// InputError, `file:line: ...`, for a missing or empty file, other names, a name that is listed twice, and impossible
// numbers.
std::map<std::string, QueryPrior> ReadQueryPriors(const QueryPriorOptions& options,
                                                  const std::function<bool(const std::string&)>& is_query);

// Return a prior of numbers as in a line of the files: position and 1, 3 or 6 numbers; gravity and its deviation.
// Throw InputError with the problem.
PositionPrior MakePositionPrior(const std::vector<double>& numbers);
GravityPrior MakeGravityPrior(const std::vector<double>& numbers, const std::string& world_up);

}  // namespace lazyloc
