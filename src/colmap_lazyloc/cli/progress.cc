#include "colmap_lazyloc/cli/progress.h"

#include <unistd.h>

#include <iomanip>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

void PrintRow(const std::string& label, double value, const std::string& unit) {
  std::cout << "  " << std::left << std::setw(34) << label << std::right << std::setw(10) << std::fixed
            << std::setprecision(3) << value << ' ' << unit << '\n';
}

// Returns a time in the unit that suits it.
std::string DurationText(double seconds) {
  if (seconds < 120) return Format("%.0f s", seconds);
  if (seconds < 2 * 3600) return Format("%.0f min", seconds / 60);
  if (seconds < 48 * 3600) return Format("%.1f h", seconds / 3600);
  return Format("%.1f days", seconds / 86400);
}

// Prints how long queries would take on several machines like this one.
void PrintRest(size_t num_queries, double queries_per_second) {
  std::cout << "  " << num_queries << " more queries would take";
  for (const int num_machines : {1, 10, 100}) {
    std::cout << (num_machines == 1 ? " " : ", ")
              << DurationText(static_cast<double>(num_queries) / queries_per_second / num_machines) << " on "
              << num_machines << (num_machines == 1 ? " machine like this" : "");
  }
  std::cout << '\n';
}

}  // namespace

Progress::Progress(const RunSize& size, const std::filesystem::path& log_path, bool append_log)
    : size_(size), is_terminal_(isatty(STDOUT_FILENO) == 1), log_path_(log_path), num_done_(size.num_done) {
  if (log_path.empty()) return;
  log_.open(log_path, append_log ? std::ios::app : std::ios::trunc);
  if (!log_) throw InputError("--log_path: " + log_path.string() + " cannot be written");
}

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
  const nlohmann::ordered_json json = {{"query", record.result.query_name},
                                       {"status", QueryStatusName(record.result.status)},
                                       {"seconds", record.total_seconds},
                                       {"done", num_done_},
                                       {"of", size_.num_queries}};
  const std::string line = json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (log_.is_open() && !(log_ << line << std::endl)) {
    throw InputError("--log_path: " + log_path_.string() + " cannot be written (is the disk full?)");
  }
  if (!is_terminal_) {
    std::cout << line << std::endl;
    return;
  }
  constexpr size_t kWidth = 40;
  const size_t filled = kWidth * num_done_ / size_.num_queries;
  std::cout << "\r[" << std::string(filled, '#') << std::string(kWidth - filled, ' ') << "] " << num_done_ << '/'
            << size_.num_queries << ", " << num_localized_ << " localized" << std::flush;
}

void Progress::PrintSummary(const QueryRecords& records) const {
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  std::map<std::string, size_t> count_of_status;
  std::vector<double> seconds, errors, tracks;
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& result = record.result;
    ++count_of_status[QueryStatusName(result.status)];
    seconds.push_back(record.total_seconds);
    if (result.status != QueryStatus::LOCALIZED) return;
    errors.push_back(result.mean_reprojection_error_px);
    tracks.push_back(result.num_tracks);
  });
  if (is_terminal_) std::cout << '\n';
  std::cout << "\n" << records.Size() << " of " << size_.num_queries << " queries done\n";
  for (const auto& [status, count] : count_of_status) {
    std::cout << "  " << std::left << std::setw(34) << status << std::right << std::setw(6) << count << '\n';
  }
  PrintRow("median time per query", seconds.empty() ? 0 : Median(seconds), "s");
  if (!errors.empty()) {
    PrintRow("median of mean reprojection error", Median(errors), "px");
    PrintRow("median number of tracks", Median(tracks), "");
  }
  const size_t num_left = size_.num_queries - num_done_ + size_.num_other_queries;
  const double rate = static_cast<double>(num_done_ - size_.num_done) / elapsed.count();
  if (rate > 0) PrintRow("rate", rate, "queries/s");
  if (rate > 0 && num_left > 0) PrintRest(num_left, rate);
  std::cout << std::flush;
}

}  // namespace lazyloc
