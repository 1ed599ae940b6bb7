#pragma once

namespace lazyloc {

// Sets up COLMAP's logging. Call it once, at the start of main().
void InitializeLogging(char** argv);

// Keeps COLMAP's logging silent without setting it up, because that belongs to the program that loads this library.
void SilenceLogging();

}  // namespace lazyloc
