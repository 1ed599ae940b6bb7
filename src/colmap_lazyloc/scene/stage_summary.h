#pragma once

#include <string>

namespace lazyloc {

// Outcome of a stage's solver.
struct StageSummary {
  bool success = false;
  std::string message = "not run";  // why the solver ended, in a few words for the user
  int iterations = 0;
  double cost = 0;  // final value of the solver's objective
};

}  // namespace lazyloc
