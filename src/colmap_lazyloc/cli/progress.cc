#include "colmap_lazyloc/cli/progress.h"

#include <sys/stat.h>
#include <unistd.h>

#include <iomanip>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

// True if another program reads the standard output, which may itself write to the terminal.
bool IsPiped() {
  struct stat status;
  return fstat(STDOUT_FILENO, &status) == 0 && S_ISFIFO(status.st_mode);
}

void PrintRow(const std::string& label, double value, const std::string& unit) {
  std::cerr << "  " << std::left << std::setw(34) << label << std::right << std::setw(10) << std::fixed
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
  std::cerr << "  " << num_queries << " more queries would take";
  for (const int num_machines : {1, 10, 100}) {
    std::cerr << (num_machines == 1 ? " " : ", ")
              << DurationText(static_cast<double>(num_queries) / queries_per_second / num_machines) << " on "
              << num_machines << (num_machines == 1 ? " machine like this" : "");
  }
  std::cerr << '\n';
}

}  // namespace

Progress::Progress(const RunSize& size, const std::filesystem::path& log_path, bool append_log)
    : size_(size),
      has_bar_(isatty(STDERR_FILENO) == 1 && !IsPiped()),
      has_lines_(!has_bar_ || isatty(STDOUT_FILENO) == 0),
      log_path_(log_path),
      num_done_(size.num_done) {
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

double Progress::SecondsLeft() const {
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  return elapsed.count() * static_cast<double>(size_.num_queries - num_done_) /
         static_cast<double>(num_done_ - size_.num_done);
}

std::string Progress::Line(const QueryRecord& record) const {
  const LocalizationResult& result = record.result;
  Json position;
  if (result.status == QueryStatus::LOCALIZED) {
    const Eigen::Vector3d cam_in_world = CamInWorld(result.cam_from_world);
    position = {cam_in_world.x(), cam_in_world.y(), cam_in_world.z()};
  }
  const Json json = {{"query", result.query_name},
                     {"status", QueryStatusName(result.status)},
                     {"confidence", result.confidence ? Json(*result.confidence) : Json()},
                     {"position", position},
                     {"seconds", record.total_seconds},
                     {"done", num_done_},
                     {"of", size_.num_queries},
                     {"seconds_left", SecondsLeft()}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void Progress::Report(const QueryRecord& record) {
  WarnOfDamages(record);
  ++num_done_;
  num_localized_ += record.result.status == QueryStatus::LOCALIZED;
  const std::string line = Line(record);
  if (log_.is_open() && !(log_ << line << std::endl)) {
    throw InputError("--log_path: " + log_path_.string() + " cannot be written (is the disk full?)");
  }
  if (has_lines_) std::cout << line << std::endl;
  if (!has_bar_) return;
  constexpr size_t kWidth = 40;
  const size_t filled = kWidth * num_done_ / size_.num_queries;
  std::cerr << "\r[" << std::string(filled, '#') << std::string(kWidth - filled, ' ') << "] " << num_done_ << '/'
            << size_.num_queries << ", " << num_localized_ << " localized, " << std::setw(8)
            << DurationText(SecondsLeft()) << " left" << std::flush;
}

bool Progress::PrintSummary(const QueryRecords& records) const {
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
  if (has_bar_) std::cerr << '\n';
  std::cerr << "\n" << records.Size() << " of " << size_.num_queries << " queries done\n";
  for (const auto& [status, count] : count_of_status) {
    std::cerr << "  " << std::left << std::setw(34) << status << std::right << std::setw(6) << count << '\n';
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
  return errors.size() == records.Size();
}

}  // namespace lazyloc
