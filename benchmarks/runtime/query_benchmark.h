#pragma once

#include <filesystem>

namespace lazyloc {

// Registers the whole query on a real scene: a folder with database.db and model/, every posed image against all the
// others. Throws InputError where it cannot be read.
void RegisterQueryBenchmark(const std::filesystem::path& scene_path);

}  // namespace lazyloc
