#pragma once

#include <filesystem>
#include <optional>

#include "colmap_lazyloc/math/geodetic.h"
#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/world_axes.h"

namespace lazyloc {

// Both functions throw InputError naming the file if it cannot be written. Numbers are as short as they can be without
// losing a bit.

// Writes a table (RFC 4180) with the position and the angles of each query. The places of a query without a pose are
// empty. axes: of the model; with a geographic origin, the table also has latitudes, longitudes and heights.
void WritePositionsCsv(const std::filesystem::path& path, const QueryRecords& records, const WorldAxes& axes);

// Writes the localized queries as a map (RFC 7946): for each a point, and what it sees as a polygon if the distance of
// the scene is known.
void WritePositionsGeojson(const std::filesystem::path& path, const QueryRecords& records, const GeodeticPoint& origin);

}  // namespace lazyloc
