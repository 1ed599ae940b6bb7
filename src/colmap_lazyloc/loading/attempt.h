#pragma once

namespace lazyloc {

// What the queries of a group are tried with.
struct Attempt {
  int num_retrieved = 20;               // database images per query
  bool compares_all_features = false;   // of photos; false: first the largest, then all along epipolar lines
  bool uses_fallback_features = false;  // of photos; false: those of the database
};

}  // namespace lazyloc
