#pragma once

namespace lazyloc {

// Runs the command `colmap lazy_indexer`; argv[0] is the program. Returns its exit code: 0, or 1 for bad options or
// files.
int RunLazyIndexer(int argc, char** argv);

}  // namespace lazyloc
