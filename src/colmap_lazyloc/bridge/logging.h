#pragma once

namespace lazyloc {

// COLMAP's logging set-up for a program.
void InitializeLogging(char** argv);

}  // namespace lazyloc
