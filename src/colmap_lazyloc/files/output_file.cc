#include "colmap_lazyloc/files/output_file.h"

#include <cerrno>
#include <locale>
#include <string>
#include <system_error>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

InputError CannotWrite(const std::filesystem::path& path) {
  const std::string cause = errno == 0 ? " (is the disk full?)" : ": " + std::generic_category().message(errno);
  return InputError(path.string() + ": cannot be written" + cause);
}

}  // namespace

OutputFile::OutputFile(const std::filesystem::path& path) : path_(path) {
  errno = 0;
  stream_.imbue(std::locale::classic());
  stream_.precision(17);
  stream_.open(path, std::ios::binary | std::ios::trunc);  // binary gives the same bytes on every system
  if (!stream_) throw CannotWrite(path_);
}

void OutputFile::Close() {
  errno = 0;
  stream_.close();
  if (!stream_) throw CannotWrite(path_);
}

}  // namespace lazyloc
