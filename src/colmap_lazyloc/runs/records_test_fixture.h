#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {

// A fixture for tests of what is made of the records of a run.
class RecordsTest : public IoTest {
 protected:
  // Writes the records to a new file and returns them as a run reads them.
  QueryRecords Stored(const std::vector<QueryRecord>& records) const {
    std::filesystem::path path;
    for (int i = 0; path.empty() || std::filesystem::exists(path); ++i) {
      path = folder_ / ("records" + std::to_string(i) + ".bin");
    }
    RecordWriter(path).Append(PackGroup(0, records));
    return QueryRecords({path});
  }
};

}  // namespace lazyloc
