#pragma once

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace lazyloc {

// Adds the wall time between its construction and its destruction to the seconds of a stage. Counts stages that end
// with an exception, too, because it adds the time in the destructor.
class StageTimer {
 public:
  using Seconds = std::vector<std::pair<std::string, double>>;

  StageTimer(std::string stage, Seconds* seconds) : stage_(std::move(stage)), seconds_(*seconds) {}
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  ~StageTimer() {
    const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    const auto is_same = [this](const auto& entry) { return entry.first == stage_; };
    const auto known = std::find_if(seconds_.begin(), seconds_.end(), is_same);
    if (known != seconds_.end()) {
      known->second += elapsed;
    } else {
      seconds_.emplace_back(stage_, elapsed);
    }
  }

 private:
  const std::string stage_;
  Seconds& seconds_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace lazyloc
