#pragma once

namespace lazyloc {

// What the queries of a group are tried with.
struct Attempt {
  int num_retrieved = 20;               // database images per query
  bool uses_fallback_features = false;  // false: those of the database
};

}  // namespace lazyloc
