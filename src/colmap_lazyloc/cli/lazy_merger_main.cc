// The command as a program of its own, for builds against an installed COLMAP.
#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/cli/commands.h"

int main(int argc, char** argv) {
  lazyloc::InitializeLogging(argv);
  return lazyloc::RunLazyMerger(argc, argv);
}
