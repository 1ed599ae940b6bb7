#include "colmap_lazyloc/cli/report_command.h"

#include <filesystem>

#include "colmap_lazyloc/bridge/colmap_version.h"

namespace lazyloc {
namespace {

// Returns a text as one word of a POSIX shell.
std::string ShellWord(const std::string& text) {
  constexpr char kPlain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_@%+=:,./-";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string word = "'";
  for (const char character : text) word += character == '\'' ? "'\\''" : std::string(1, character);
  return word + "'";
}

}  // namespace

std::string ReportCommand(const CommandOptions& options) {
  const std::filesystem::path page = std::filesystem::path(options.output_path) / "report.html";
  std::string command = "python -m colmap_lazyloc.report " + ShellWord(options.output_path);
  const std::string& image_path = options.source.photos.image_path;
  if (!image_path.empty()) command += " --image_path " + ShellWord(image_path);
  command += " --database_path " + ShellWord(options.source.database_path);
  return command + " --output " + ShellWord(page.string());
}

std::string ProgramVersion() { return "colmap_lazyloc " LAZYLOC_VERSION ", " + ColmapVersion(); }

}  // namespace lazyloc
