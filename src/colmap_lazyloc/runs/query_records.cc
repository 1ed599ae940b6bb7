#include "colmap_lazyloc/runs/query_records.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Stays below the usual limit of open files.
constexpr size_t kMaxNumOpen = 500;

QueryRecords::QueryRecords(std::vector<std::filesystem::path> paths)
    : paths_(std::move(paths)), readers_(paths_.size()) {
  for (size_t file = 0; file < paths_.size(); ++file) AddFile(static_cast<uint32_t>(file));
  std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.name < b.name; });
  const auto doubled = std::adjacent_find(entries_.begin(), entries_.end(),
                                          [](const Entry& a, const Entry& b) { return a.name == b.name; });
  if (doubled != entries_.end()) {
    throw InputError(paths_[doubled->file].string() + ": query " + doubled->name + " has two records, the other in " +
                     paths_[(doubled + 1)->file].string());
  }
}

void QueryRecords::AddFile(uint32_t file) {
  RecordReader reader(paths_[file]);
  while (reader.Next()) {
    VisitGroup(reader.Record(), [&](const std::string& name, uint64_t offset) {
      entries_.push_back({name, reader.Offset() + offset, file});
    });
  }
  if (reader.NumIntactBytes() != reader.NumBytes()) {
    throw InputError(paths_[file].string() + ": is damaged from byte " + std::to_string(reader.NumIntactBytes()) +
                     " on");
  }
}

std::vector<size_t> QueryRecords::CountByFile() const {
  std::vector<size_t> counts(paths_.size());
  for (const Entry& entry : entries_) ++counts[entry.file];
  return counts;
}

std::optional<size_t> QueryRecords::Find(std::string_view name) const {
  const auto entry = std::lower_bound(entries_.begin(), entries_.end(), name,
                                      [](const Entry& a, std::string_view b) { return a.name < b; });
  if (entry == entries_.end() || entry->name != name) return std::nullopt;
  return static_cast<size_t>(entry - entries_.begin());
}

RecordReader& QueryRecords::Reader(uint32_t file) const {
  if (!readers_[file]) {
    if (num_open_ == kMaxNumOpen) {
      for (std::unique_ptr<RecordReader>& reader : readers_) reader.reset();
      num_open_ = 0;
    }
    readers_[file] = std::make_unique<RecordReader>(paths_[file]);
    ++num_open_;
  }
  return *readers_[file];
}

QueryRecord QueryRecords::Read(size_t index, RecordParts parts) const {
  const Entry& entry = entries_.at(index);
  return ReadRecord(entry.offset, parts, &Reader(entry.file));
}

void QueryRecords::ForEach(const std::function<void(const QueryRecord&)>& visit) const {
  for (size_t i = 0; i < Size(); ++i) visit(Read(i, RecordParts::HEAD));
}

}  // namespace lazyloc
