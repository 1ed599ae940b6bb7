#include "colmap_lazyloc/cli/report_command.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <sstream>

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

constexpr char kLazyloc[] = "lazyloc";

// Returns a text as one word of a POSIX shell.
std::string ShellWord(const std::string& text) {
  constexpr char kPlain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_@%+=:,./-";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string word = "'";
  for (const char character : text) word += character == '\'' ? "'\\''" : std::string(1, character);
  return word + "'";
}

bool IsProgram(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored) && access(path.c_str(), X_OK) == 0;
}

}  // namespace

std::string FindLazyloc(const std::string& own_path) {
  const char* const search_path = std::getenv("PATH");
  std::istringstream folders(search_path == nullptr ? "" : search_path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (IsProgram(fs::path(folder) / kLazyloc)) return kLazyloc;
  }
  std::error_code ignored;
  // Python has its own path in /proc; a command that is found in PATH has no folder in argv[0].
  const bool has_folder = own_path.find('/') != std::string::npos;
  const fs::path program = has_folder ? fs::absolute(own_path, ignored) : fs::read_symlink("/proc/self/exe", ignored);
  for (const fs::path& place : {fs::path(kLazyloc), fs::path("../../scripts") / kLazyloc}) {
    const fs::path lazyloc = (program.parent_path() / place).lexically_normal();
    if (IsProgram(lazyloc)) return ShellWord(lazyloc.string());
  }
  return "";
}

void PrintReportCommand(const std::string& own_path, const CommandOptions& options) {
  const std::string lazyloc = FindLazyloc(own_path);
  if (!lazyloc.empty()) std::cerr << "report: " << ReportCommand(lazyloc, options) << std::endl;
}

std::string ReportCommand(const std::string& lazyloc, const CommandOptions& options) {
  const fs::path page = fs::path(options.output_path) / "report.html";
  std::string command = lazyloc + " report " + ShellWord(options.output_path);
  const std::string& image_path = options.source.photos.image_path;
  if (!image_path.empty()) command += " --image_path " + ShellWord(image_path);
  command += " --database_path " + ShellWord(options.source.database_path);
  return command + " --output " + ShellWord(page.string());
}

}  // namespace lazyloc
