#pragma once

#include <string>

namespace lazyloc {

// How a stage's solver ended.
struct StageSummary {
  bool success = false;
  std::string message = "not run";
  int iterations = 0;
  double cost = 0;
};

}  // namespace lazyloc
