#pragma once

#include <filesystem>
#include <optional>

#include "colmap_lazyloc/math/geodetic.h"
#include "colmap_lazyloc/scene/world_axes.h"

namespace lazyloc {

// Name of the file in a model's folder that says where on Earth the model is: its axes point to the east, to the north
// and upwards (ENU) at an origin, and its unit is the metre.
inline constexpr char kGeoFile[] = "geo.json";
// Name of a file beside a model whose axes are arbitrary. `lazyloc run` writes the same (project/steps.py).
inline constexpr char kArbitraryAxesFile[] = "arbitrary_axes.txt";

// Returns the origin; nullopt if there is no such file. Throws InputError naming the file if it is not of this format.
std::optional<GeodeticPoint> ReadGeoFile(const std::filesystem::path& path);

// Throws InputError naming the file if it cannot be written.
void WriteGeoFile(const std::filesystem::path& path, const GeodeticPoint& origin);

// Read and write what the files in a model's folder say of its axes.
WorldAxes ReadAxes(const std::filesystem::path& folder);
void WriteAxes(const std::filesystem::path& folder, const WorldAxes& axes);

}  // namespace lazyloc
