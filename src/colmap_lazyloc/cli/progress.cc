#include "colmap_lazyloc/cli/progress.h"

#include <unistd.h>

#include <iomanip>
#include <iostream>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/io/leave_one_out.h"
#include "colmap_lazyloc/math/median.h"

namespace lazyloc {
namespace {

void PrintRow(const std::string& label, double value, const std::string& unit) {
  std::cout << "  " << std::left << std::setw(34) << label << std::right << std::setw(10) << std::fixed
            << std::setprecision(3) << value << ' ' << unit << '\n';
}

}  // namespace

Progress::Progress(size_t num_queries) : num_queries_(num_queries), is_terminal_(isatty(STDOUT_FILENO) == 1) {}

void Progress::WarnOfDamages(const QueryRecord& record) {
  constexpr size_t kMaxNumWarnings = 20;
  for (const std::string& damage : record.damages) {
    if (damages_.size() > kMaxNumWarnings || !damages_.insert(damage).second) continue;
    PrintWarning(damages_.size() > kMaxNumWarnings ? "more damaged records are in results.jsonl"
                                                   : damage + ": leaving it out of the pairs of queries");
  }
}

void Progress::Report(const QueryRecord& record) {
  WarnOfDamages(record);
  ++num_done_;
  num_localized_ += record.result.status == QueryStatus::LOCALIZED;
  if (is_terminal_) {
    constexpr size_t kWidth = 40;
    const size_t filled = kWidth * num_done_ / num_queries_;
    std::cout << "\r[" << std::string(filled, '#') << std::string(kWidth - filled, ' ') << "] " << num_done_ << '/'
              << num_queries_ << ", " << num_localized_ << " localized" << std::flush;
    return;
  }
  const nlohmann::ordered_json line = {{"query", record.result.query_name},
                                       {"status", QueryStatusName(record.result.status)},
                                       {"seconds", record.total_seconds},
                                       {"done", num_done_},
                                       {"of", num_queries_}};
  std::cout << line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
}

void Progress::PrintSummary(const std::vector<QueryRecord>& records) const {
  std::map<std::string, size_t> count_of_status;
  std::vector<double> seconds, errors, tracks;
  for (const QueryRecord& record : records) {
    const LocalizationResult& result = record.result;
    ++count_of_status[QueryStatusName(result.status)];
    seconds.push_back(record.total_seconds);
    if (result.status != QueryStatus::LOCALIZED) continue;
    errors.push_back(result.mean_reprojection_error_px);
    tracks.push_back(result.num_tracks);
  }
  if (is_terminal_) std::cout << '\n';
  std::cout << "\n" << records.size() << " of " << num_queries_ << " queries done\n";
  for (const auto& [status, count] : count_of_status) {
    std::cout << "  " << std::left << std::setw(34) << status << std::right << std::setw(6) << count << '\n';
  }
  PrintRow("median time per query", seconds.empty() ? 0 : Median(seconds), "s");
  if (!errors.empty()) {
    PrintRow("median of mean reprojection error", Median(errors), "px");
    PrintRow("median number of tracks", Median(tracks), "");
  }
  std::cout << std::flush;
}

void Progress::PrintLeaveOneOut(const Model& model, const std::vector<QueryRecord>& records) {
  std::vector<const QueryRecord*> pointers;
  for (const QueryRecord& record : records) pointers.push_back(&record);
  std::cout << FormatLeaveOneOut(SummarizeLeaveOneOut(model, pointers)) << std::flush;
}

}  // namespace lazyloc
