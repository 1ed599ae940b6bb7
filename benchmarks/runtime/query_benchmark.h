#pragma once

#include <filesystem>

namespace lazyloc {

// Registers a benchmark of the whole query on a real scene, which is a folder with database.db and model/. Every posed
// image is a query, and all other images are its database. Throws InputError if the scene cannot be read.
void RegisterQueryBenchmark(const std::filesystem::path& scene_path);

}  // namespace lazyloc
