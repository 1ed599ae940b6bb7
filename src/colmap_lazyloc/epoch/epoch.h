#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/scene/control_point.h"
#include "colmap_lazyloc/scene/model.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

struct EpochOptions {
  bool shares_intrinsics = true;  // among photos for which the database states the same
  double min_confidence = 0.9;    // of photos that only other new photos place
  double mark_stddev_px = 1;      // of the marks of control points, per coordinate
  int num_threads = -1;           // -1: the number of cores

  bool Check(std::string* error) const;
};

// Adjusts new photos together. The images of the model do not move. localized: what colmap lazy_localizer has
// found for each photo. Photos that it has not localized are placed by their matches with those that it has, as far as
// these give a pose. control: surveyed points, in whose frame the photos are at last; empty: the frame is that of the
// database poses. scratch_file: a path that may be written. Returns a record per photo, in the order of names.
// report: gets a line on each step.
std::vector<QueryRecord> AdjustEpoch(const Model& model, std::vector<LocalizationResult> localized,
                                     const std::vector<ControlPoint>& control, const DatabaseReader& database,
                                     const EpochOptions& options, const std::filesystem::path& scratch_file,
                                     const std::function<void(const std::string&)>& report);

}  // namespace lazyloc
