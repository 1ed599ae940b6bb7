#pragma once

#include <string>

namespace lazyloc {

// Sets up COLMAP's logging. Call it once, at the start of main().
void InitializeLogging(char** argv);

// Keeps COLMAP's logging silent without setting it up, because that belongs to the program that loads this library.
void SilenceLogging();

// Returns the name and version of the COLMAP that is linked, for example "COLMAP 3.10".
std::string ColmapVersion();

}  // namespace lazyloc
