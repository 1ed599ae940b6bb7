// A command as a program of its own, for builds against an installed COLMAP. LAZYLOC_RUN: its function.
#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/cli/commands.h"

int main(int argc, char** argv) {
  lazyloc::InitializeLogging(argv);
  return LAZYLOC_RUN(argc, argv);
}
