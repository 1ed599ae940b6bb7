#pragma once

namespace lazyloc {

// Sets up COLMAP's logging. Call it once, at the start of main().
void InitializeLogging(char** argv);

}  // namespace lazyloc
