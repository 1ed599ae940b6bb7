#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <queue>
#include <type_traits>
#include <utility>
#include <vector>

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
    if (runs_.empty()) {
      std::sort(values_.begin(), values_.end());
      for (const T& value : values_) visit(value);
      return;
    }
    if (!values_.empty()) WriteRun();
    std::vector<T>().swap(values_);
    file_.flush();
    Merge(visit);
  }

 private:
  // Values num_read..num_values of a sorted run, of which some are in memory.
  struct Run {
    size_t first = 0, num_values = 0;
    std::vector<T> buffer;
    size_t next = 0;  // in the buffer
  };

  void CheckFile() const {
    if (!file_) throw InputError(path_.string() + ": cannot be written (is the disk full?)");
  }

  void WriteRun() {
    if (runs_.empty()) {
      file_.open(path_, std::ios::binary | std::ios::trunc | std::ios::in | std::ios::out);
      values_.reserve(max_num_in_memory_);
    }
    std::sort(values_.begin(), values_.end());
    file_.write(reinterpret_cast<const char*>(values_.data()),
                static_cast<std::streamsize>(values_.size() * sizeof(T)));
    CheckFile();
    Run run;
    run.first = num_written_;
    run.num_values = values_.size();
    num_written_ += values_.size();
    runs_.push_back(std::move(run));
    values_.clear();
  }

  // Reads the next values of a run. Returns false at its end.
  bool Fill(Run* run) {
    const size_t num = std::min(run->num_values, std::max<size_t>(1, max_num_in_memory_ / runs_.size()));
    run->buffer.resize(num);
    run->next = 0;
    if (num == 0) return false;
    file_.seekg(static_cast<std::streamoff>(run->first * sizeof(T)));
    file_.read(reinterpret_cast<char*>(run->buffer.data()), static_cast<std::streamsize>(num * sizeof(T)));
    CheckFile();
    run->first += num;
    run->num_values -= num;
    return true;
  }

  void Merge(const std::function<void(const T&)>& visit) {
    const auto is_later = [this](size_t a, size_t b) { return Front(runs_[b]) < Front(runs_[a]); };
    std::priority_queue<size_t, std::vector<size_t>, decltype(is_later)> order(is_later);
    for (size_t i = 0; i < runs_.size(); ++i) {
      if (Fill(&runs_[i])) order.push(i);
    }
    while (!order.empty()) {
      const size_t i = order.top();
      order.pop();
      visit(Front(runs_[i]));
      if (++runs_[i].next < runs_[i].buffer.size() || Fill(&runs_[i])) order.push(i);
    }
  }

  static const T& Front(const Run& run) { return run.buffer[run.next]; }

  const std::filesystem::path path_;
  const size_t max_num_in_memory_;
  std::vector<T> values_;
  std::fstream file_;
  std::vector<Run> runs_;
  size_t num_written_ = 0;
};

}  // namespace lazyloc
