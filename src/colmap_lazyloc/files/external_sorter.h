#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <functional>
#include <queue>
#include <type_traits>
#include <utility>
#include <vector>

#include <boost/interprocess/file_mapping.hpp>
#include <boost/interprocess/mapped_region.hpp>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Sorts values of which only a part fits into memory: sorted runs of them go to a file and are merged. Throws
// InputError naming the file if it cannot be written.
template <typename T>
class ExternalSorter {
  static_assert(std::is_trivially_copyable_v<T>, "the file holds the bytes of the values");

 public:
  ExternalSorter(std::filesystem::path path, size_t max_num_in_memory)
      : path_(std::move(path)), max_num_in_memory_(max_num_in_memory) {}

  void Add(const T& value) {
    if (values_.size() == max_num_in_memory_) WriteRun();
    values_.push_back(value);
  }

  // Visits all values in ascending order; they are gone then.
  void Visit(const std::function<void(const T&)>& visit) {
    if (!file_.is_open()) {
      std::sort(values_.begin(), values_.end());
      for (const T& value : values_) visit(value);
      return;
    }
    WriteRun();
    std::vector<T>().swap(values_);
    file_.close();
    CheckFile();
    Merge(visit);
  }

 private:
  void CheckFile() const {
    if (!file_) throw InputError(path_.string() + ": cannot be written (is the disk full?)");
  }

  void WriteRun() {
    if (!file_.is_open()) file_.open(path_, std::ios::binary);
    std::sort(values_.begin(), values_.end());
    file_.write(reinterpret_cast<const char*>(values_.data()),
                static_cast<std::streamsize>(values_.size() * sizeof(T)));
    CheckFile();
    num_written_ += values_.size();
    values_.clear();
  }

  void Merge(const std::function<void(const T&)>& visit) {
    namespace ipc = boost::interprocess;
    const ipc::mapped_region region(ipc::file_mapping(path_.c_str(), ipc::read_only), ipc::read_private);
    const T* const values = static_cast<const T*>(region.get_address());
    using Run = std::pair<const T*, const T*>;  // its next value and its end
    const auto is_later = [](const Run& a, const Run& b) { return *b.first < *a.first; };
    std::priority_queue<Run, std::vector<Run>, decltype(is_later)> runs(is_later);
    for (size_t begin = 0; begin < num_written_; begin += max_num_in_memory_) {
      runs.emplace(values + begin, values + std::min(begin + max_num_in_memory_, num_written_));
    }
    while (!runs.empty()) {
      Run run = runs.top();
      runs.pop();
      visit(*run.first++);
      if (run.first != run.second) runs.push(run);
    }
  }

  const std::filesystem::path path_;
  const size_t max_num_in_memory_;
  std::vector<T> values_;
  std::ofstream file_;  // runs of max_num_in_memory_ values; the last one may be shorter
  size_t num_written_ = 0;
};

}  // namespace lazyloc
