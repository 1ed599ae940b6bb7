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

  // Adds wall time to that of a stage; a stage that runs again has one entry.
  static void Add(const std::string& stage, double elapsed, Seconds* seconds) {
    const auto is_same = [&](const auto& entry) { return entry.first == stage; };
    const auto known = std::find_if(seconds->begin(), seconds->end(), is_same);
    if (known != seconds->end()) {
      known->second += elapsed;
    } else {
      seconds->emplace_back(stage, elapsed);
    }
  }

  StageTimer(std::string stage, Seconds* seconds) : stage_(std::move(stage)), seconds_(*seconds) {}
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  ~StageTimer() {
    Add(stage_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(), &seconds_);
  }

 private:
  const std::string stage_;
  Seconds& seconds_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Runs a stage and adds its wall time.
template <typename Stage>
auto Timed(const char* name, StageTimer::Seconds* seconds, const Stage& stage) {
  const StageTimer timer(name, seconds);
  return stage();
}

}  // namespace lazyloc
