#include "colmap_lazyloc/runs/run_manifest.h"

#include <algorithm>
#include <fstream>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

// Raised when the meaning of the file of records or of the manifest changes.
constexpr int kFormat = 1;

OptionTexts OptionsFrom(const Json& json) {
  OptionTexts options;
  for (const auto& [name, value] : json.items()) options.emplace_back(name, value.get<std::string>());
  return options;
}

std::string ChangeOfOptions(const OptionTexts& now, const OptionTexts& earlier) {
  for (size_t i = 0; i < now.size() && i < earlier.size(); ++i) {
    if (now[i] == earlier[i]) continue;
    return "option --" + now[i].first + " is '" + now[i].second + "' and was '" + earlier[i].second + "'";
  }
  return "";
}

std::string ChangeOfInputs(const std::map<std::string, RunManifest::Input>& now,
                           const std::map<std::string, RunManifest::Input>& earlier) {
  for (const auto& [name, input] : now) {
    const auto before = earlier.find(name);
    if (before == earlier.end()) return "option --" + name + " is '" + input.path + "' and was not given";
    if (input.fingerprint.IsChanged(before->second.fingerprint)) {
      return input.path + " (--" + name + ") has changed or is not the same file as " + before->second.path;
    }
  }
  for (const auto& [name, input] : earlier) {
    if (now.count(name) == 0) return "option --" + name + " is not given and was '" + input.path + "'";
  }
  return "";
}

}  // namespace

bool Shard::Has(const std::string& group_name) const { return Crc32(group_name) % count == index - 1; }

std::optional<Shard> ParseShard(const std::string& text) {
  const size_t slash = std::min(text.find('/'), text.size());
  const auto index = NumberFrom<uint32_t>(std::string_view(text).substr(0, slash));
  const auto count = NumberFrom<uint32_t>(std::string_view(text).substr(std::min(slash + 1, text.size())));
  if (!index || !count || *index < 1 || *index > *count) return std::nullopt;
  return Shard{*index, *count};
}

std::string RunManifest::ChangeSince(const RunManifest& earlier) const {
  if (program != earlier.program) return "the program is " + program + " and was " + earlier.program;
  std::string change = ChangeOfOptions(options, earlier.options);
  if (change.empty()) change = ChangeOfInputs(inputs, earlier.inputs);
  if (change.empty() && (num_groups != earlier.num_groups || num_queries != earlier.num_queries)) {
    change = "there are " + std::to_string(num_queries) + " queries in " + std::to_string(num_groups) +
             " groups and there were " + std::to_string(earlier.num_queries) + " in " +
             std::to_string(earlier.num_groups);
  }
  return change;
}

std::string RunManifest::ToJson() const {
  Json json = {{"format", kFormat}, {"program", program}, {"shard", shard ? Json(shard->Text()) : Json()}};
  json["num_own_queries"] = num_own_queries;
  json["num_queries"] = num_queries;
  json["num_groups"] = num_groups;
  json["options"] = Json::object_t(options.begin(), options.end());
  json["inputs"] = Json::object();
  for (const auto& [name, input] : inputs) {
    const Fingerprint& fingerprint = input.fingerprint;
    json["inputs"][name] = {{"path", input.path},
                            {"content", fingerprint.content},
                            {"identity", fingerprint.identity},
                            {"modified", fingerprint.modified}};
  }
  json["extraction"] = extraction;
  json["other_options"] = Json::object_t(other_options.begin(), other_options.end());
  // Replaces bytes of paths that are not UTF-8, which are only shown.
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + '\n';
}

RunManifest ReadManifest(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be opened");
  try {
    const Json json = Json::parse(file);
    if (json.at("format") != kFormat) throw InputError(path.string() + ": was written by another version");
    RunManifest manifest;
    manifest.program = json.at("program").get<std::string>();
    if (!json.at("shard").is_null()) manifest.shard = ParseShard(json.at("shard").get<std::string>());
    manifest.num_own_queries = json.at("num_own_queries").get<uint64_t>();
    manifest.num_queries = json.at("num_queries").get<uint64_t>();
    manifest.num_groups = json.at("num_groups").get<uint64_t>();
    manifest.options = OptionsFrom(json.at("options"));
    for (const auto& [name, input] : json.at("inputs").items()) {
      const auto text = [&input = input](const char* key) { return input.at(key).template get<std::string>(); };
      manifest.inputs[name] = {text("path"), {text("content"), text("identity"), text("modified")}};
    }
    manifest.extraction = json.at("extraction").get<std::string>();
    manifest.other_options = OptionsFrom(json.at("other_options"));
    return manifest;
  } catch (const Json::exception& error) {
    throw InputError(path.string() + ": is not a manifest: " + error.what());
  }
}

}  // namespace lazyloc
