#include "colmap_lazyloc/options/options.h"

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <iostream>
#include <numeric>
#include <utility>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/options/option_list.h"
#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

namespace po = boost::program_options;

// Reads an option that is an enum by the name of its value. Boost finds this function by the enum's namespace.
template <typename Enum, typename = std::enable_if_t<std::is_enum_v<Enum>>>
void validate(boost::any& value, const std::vector<std::string>& texts, Enum*, int) {  // NOLINT: the name is Boost's
  std::string allowed;
  for (size_t i = 0; i < kEnumNames<Enum>.size(); ++i) {
    if (texts.back() == kEnumNames<Enum>[i]) {
      value = static_cast<Enum>(i);
      return;
    }
    allowed += (i == 0 ? "" : ", ") + std::string(kEnumNames<Enum>[i]);
  }
  throw po::error_with_option_name("option '%canonical_option%' must be one of " + allowed + ", but is '" +
                                   texts.back() + "'");
}

// colmap lazy_indexer has five options, none of them advanced.
template <typename Add>
void ForEachBasicOption(IndexerOptions& o, const Add& add) {
  add("database_path", &o.database_path, "COLMAP database with SIFT descriptors; opened read-only");
  add("index_path", &o.index_path, "File of the index; an existing index is updated");
  add("LazyIndexer.num_visual_words", &o.retrieval.num_visual_words,
      "Maximum number of visual words in the index; a small database has fewer words");
  add("LazyIndexer.max_num_features", &o.retrieval.max_num_features,
      "Maximum number of indexed features per image; the features of the largest scales are kept; -1: all features; "
      "an existing index keeps the number with which it was made");
  add("LazyIndexer.num_threads", &o.num_threads, "Number of threads; -1 uses all cores");
}
template <typename Add>
void ForEachAdvancedOption(IndexerOptions&, const Add&) {}

template <typename Add>
void ForEachBasicOption(MergerOptions& o, const Add& add) {
  add("input_path", &o.input_path,
      "Folder with the output folders of all shards, or a file with one of these folders per line");
  add("output_path", &o.output_path,
      "Folder for the joined results, in the same files as the results of colmap lazy_localizer");
  add("database_path", &o.database_path,
      "COLMAP database of the shards; default: the --database_path with which the shards were run");
  add("model_path", &o.model_path,
      "Folder of the COLMAP model of the shards; default: the --input_path with which the shards were run");
}
template <typename Add>
void ForEachAdvancedOption(MergerOptions&, const Add&) {}

template <typename Add>
void ForEachBasicOption(EpochCommandOptions& o, const Add& add) {
  add("database_path", &o.database_path,
      "COLMAP database with the keypoints of the new photos and the database images, and verified matches of the new "
      "photos with database images and with each other; opened read-only");
  add("input_path", &o.input_path,
      "Folder of the COLMAP model of the database images; the poses of these images do not change");
  add("localized_path", &o.localized_path, "Output folder of colmap lazy_localizer for the new photos");
  add("output_path", &o.output_path,
      "Folder for the results, in the same files as the results of colmap lazy_localizer");
  add("control_points_path", &o.control_points_path,
      "Text file of control points. Each control point is a line `point NAME x y z stddev_x stddev_y stddev_z`, "
      "followed by its marks in photos and database images: lines `mark IMAGE x y`. With this option, the results are "
      "in the coordinates of the control points; default: the coordinates of the database images");
  add("LazyEpoch.mark_stddev_px", &o.epoch.mark_stddev_px,
      "Standard deviation of each coordinate of a control point's mark, in pixels");
  add("LazyEpoch.with_database", &o.with_database,
      "Also write the database images into the model, with unchanged poses");
  add("LazyEpoch.shared_intrinsics", &o.epoch.shares_intrinsics,
      "Refine one camera for all photos that have the same intrinsics in the database; 0: refine one camera for each "
      "photo");
  add("LazyEpoch.min_confidence", &o.epoch.min_confidence,
      "Minimum probability that the position is right, for a photo that can be localized only by its matches with "
      "other new photos");
  add("LazyEpoch.num_threads", &o.epoch.num_threads, "Number of threads; -1 uses all cores");
}
template <typename Add>
void ForEachAdvancedOption(EpochCommandOptions&, const Add&) {}

namespace {

// Returns a value as the command line reads it. Numbers are written as in JSON, which is exact and short.
template <typename Value>
std::string AsText(const Value& value) {
  if constexpr (std::is_same_v<Value, std::string>) {
    return value;
  } else if constexpr (std::is_same_v<Value, bool>) {
    return value ? "1" : "0";
  } else if constexpr (std::is_enum_v<Value>) {
    return EnumName(value);
  } else {
    return nlohmann::json(value).dump();
  }
}

// Collects words that are not options, so that a message can name them.
constexpr const char* kStrayArguments = "stray-arguments";

// The options in two parts: those that most users need, and the others.
struct Descriptions {
  const char* summary;
  po::options_description basic, advanced;
};

template <typename Options>
Descriptions Describe(const char* summary, Options* options, std::string* project_path) {
  Descriptions descriptions{summary,
                            po::options_description("Options (switches take 0 or 1; defaults are in parentheses)"),
                            po::options_description("Advanced options")};
  const auto add_to = [](po::options_description* description) {
    return [description](const char* name, auto* value, const char* help, OptionRole = OptionRole::METHOD) {
      description->add_options()(name, po::value(value)->default_value(*value, AsText(*value)), help);
    };
  };
  auto add_switch = descriptions.basic.add_options();
  add_switch("help,h", "Print this help");
  ForEachAdvancedOption(*options, add_to(&descriptions.advanced));
  if (!descriptions.advanced.options().empty()) add_switch("help-all", "Print the help of all options");
  add_switch("version", "Print the versions of this program and of COLMAP");
  add_switch("project_path", po::value(project_path),
             "File (.ini) with any of these options; options on the command line take precedence");
  ForEachBasicOption(*options, add_to(&descriptions.basic));
  return descriptions;
}

void CheckRequired(std::initializer_list<std::pair<const char*, const std::string*>> options) {
  std::string missing;
  for (const auto& [name, value] : options) {
    if (value->empty()) missing += (missing.empty() ? "--" : ", --") + std::string(name);
  }
  if (!missing.empty()) throw InputError("required but missing: " + missing);
}

// Returns an error whose message begins with the name of a field, which becomes the full name of its option.
template <typename Options>
InputError OptionError(Options& options, const std::string& message) {
  const std::string field = message.substr(0, message.find(' '));
  std::string option = field;
  ForEachOption(options, [&](const std::string& name, const auto*, const char*, OptionRole = OptionRole::METHOD) {
    if (option == field && name.substr(name.rfind('.') + 1) == field) option = name;
  });
  return InputError("option --" + option + message.substr(field.size()));
}

void CheckValues(CommandOptions* options) {
  std::string error;
  if (options->num_threads < 1 && options->num_threads != -1) error = "num_threads must be >= 1, or -1";
  if (options->resume && options->overwrite) error = "resume excludes --overwrite";
  if (!options->shard.empty() && !ParseShard(options->shard)) {
    error = "shard must be two numbers like 17/256, the first from 1 to the second, but is '" + options->shard + "'";
  }
  const bool has_matches_output = !options->source.photos.matches_output_path.empty();
  if (has_matches_output && (options->resume || !options->shard.empty())) {
    error = "matches_output_path excludes --resume and --shard, because the file has the features of one whole run";
  }
  if (options->source.photos.on_demand && !options->shard.empty()) {
    error = "on_demand excludes --shard, because colmap lazy_merger has no photos";
  }
  if (!error.empty() || !options->source.Check(&error) || !options->localizer.Check(&error)) {
    throw OptionError(*options, error);
  }
}

void CheckOptions(CommandOptions* options) {
  CheckRequired({{"database_path", &options->source.database_path},
                 {"input_path", &options->source.input_path},
                 {"output_path", &options->output_path}});
  std::string error;
  if (!options->source.photos.CheckImagePath(&error)) throw OptionError(*options, error);
  CheckValues(options);
}

void CheckOptions(IndexerOptions* options) {
  CheckRequired({{"database_path", &options->database_path}, {"index_path", &options->index_path}});
  std::string error;
  if (options->num_threads < 1 && options->num_threads != -1) error = "num_threads must be >= 1, or -1";
  if (!error.empty() || !options->retrieval.Check(&error)) throw OptionError(*options, error);
}

void CheckOptions(MergerOptions* options) {
  CheckRequired({{"input_path", &options->input_path}, {"output_path", &options->output_path}});
}

void CheckOptions(EpochCommandOptions* options) {
  CheckRequired({{"database_path", &options->database_path},
                 {"input_path", &options->input_path},
                 {"localized_path", &options->localized_path},
                 {"output_path", &options->output_path}});
  std::string error;
  if (!options->epoch.Check(&error)) throw OptionError(*options, error);
}

// Options that --help shows; --help-all shows all.
struct HelpGroup {
  const char* title;
  std::vector<const char*> options;
};

const HelpGroup kHelpGroups[] = {
    {"What you need", {"database_path", "input_path", "output_path"}},
    {"Queries", {"query_list_path", "pairs_path", "LazyLocalizer.leave_one_out", "LazyLocalizer.intrinsics"}},
    {"Photos", {"image_path", "retrieval_index_path", "onnx_path"}},
    {"Several at once", {"rig_config_path", "query_trajectory_path", "LazyLocalizer.group_size"}},
    {"Further measurements", {"query_position_path", "query_gravity_path", "depth_path"}},
    {"Output", {"LazyLocalizer.min_confidence", "LazyLocalizer.num_threads", "resume", "strict"}},
};

constexpr char kExamples[] =
    R"(Examples:
  colmap lazy_localizer --database_path database.db --input_path model --output_path localized
  colmap lazy_localizer --database_path database.db --input_path model --output_path localized \
      --image_path photos --query_list_path queries.txt
)";

// Prints the options that most users of colmap lazy_localizer need, in groups.
void PrintGroupedHelp(const Descriptions& descriptions) {
  constexpr unsigned kLineLength = 110, kMinTextLength = 60;
  po::options_description groups(kLineLength, kMinTextLength);
  for (const HelpGroup& group : kHelpGroups) {
    po::options_description options(group.title, kLineLength, kMinTextLength);
    for (const char* name : group.options) {
      const auto is_option = [&](const auto& option) { return option->long_name() == name; };
      const auto& basic = descriptions.basic.options();
      options.add(*std::find_if(basic.begin(), basic.end(), is_option));
    }
    groups.add(options);
  }
  std::cout << descriptions.summary << "\n\n"
            << kExamples << groups
            << "\nSwitches take 0 or 1. Defaults are in parentheses. --help-all shows all options, "
            << "--version the version.\n";
}

// Prints what one of the options --version, --help and --help-all requests. Returns false if there is none of them.
bool PrintAnswer(const po::variables_map& values, const Descriptions& descriptions) {
  if (values.count("version") > 0) {
    std::cout << ProgramVersion() << std::endl;
  } else if (values.count("help-all") > 0) {
    std::cout << descriptions.summary << '\n' << descriptions.basic << '\n' << descriptions.advanced << std::endl;
  } else if (values.count("help") > 0) {
    if (descriptions.advanced.options().empty()) {
      std::cout << descriptions.summary << '\n' << descriptions.basic << std::endl;
    } else {
      PrintGroupedHelp(descriptions);
    }
  } else {
    return false;
  }
  return true;
}

// Returns the number of characters to insert, delete or replace so that one text becomes the other.
size_t EditDistance(const std::string& from, const std::string& to) {
  std::vector<size_t> distances(to.size() + 1);  // to the beginnings of `to`
  std::iota(distances.begin(), distances.end(), 0);
  for (size_t i = 0; i < from.size(); ++i) {
    size_t diagonal = std::exchange(distances[0], i + 1);
    for (size_t j = 0; j < to.size(); ++j) {
      const size_t replaced = diagonal + (from[i] == to[j] ? 0 : 1);
      diagonal = distances[j + 1];
      distances[j + 1] = std::min({replaced, diagonal + 1, distances[j] + 1});
    }
  }
  return distances.back();
}

// Returns what an error about an unknown option ends with: the nearest option, or nothing. What is before the last dot
// does not count, and a name may lack its end.
std::string Nearest(const std::string& name, const po::options_description& known) {
  const auto last = [](const std::string& full) { return full.substr(full.rfind('.') + 1); };
  std::string nearest;
  size_t best = last(name).size() / 3 + 1;
  for (const auto& option : known.options()) {
    const std::string& full = option->long_name();
    const size_t distance = full.rfind(name, 0) == 0 ? 1 : EditDistance(last(name), last(full));
    if (distance < best) {
      best = distance;
      nearest = "; the nearest is --" + full;
    }
  }
  return nearest;
}

// Fills the variables that the descriptions name. Returns false if only the help or the version was requested, which is
// then printed.
bool Parse(int argc, char** argv, const std::string& command, const Descriptions& descriptions) {
  po::options_description all;
  all.add(descriptions.basic).add(descriptions.advanced);
  po::options_description with_stray_arguments(all);
  with_stray_arguments.add_options()(kStrayArguments, po::value<std::vector<std::string>>());
  po::variables_map values;
  try {
    po::store(po::command_line_parser(argc, argv)
                  .options(with_stray_arguments)
                  .positional(po::positional_options_description().add(kStrayArguments, -1))
                  .style(po::command_line_style::default_style & ~po::command_line_style::allow_guessing)
                  .run(),
              values);
    if (PrintAnswer(values, descriptions)) return false;
    if (values.count(kStrayArguments) > 0) {
      throw InputError(command + ": `" + values[kStrayArguments].as<std::vector<std::string>>().front() +
                       "` is not an option (see " + command + " -h)");
    }
    if (values.count("project_path") > 0) {
      std::ifstream file(values["project_path"].as<std::string>());
      if (!file) throw InputError("--project_path: cannot read " + values["project_path"].as<std::string>());
      po::store(po::parse_config_file(file, all), values);
    }
    po::notify(values);
  } catch (const po::unknown_option& error) {
    std::string name = error.get_option_name();
    name.erase(0, name.find_first_not_of('-'));
    name.erase(std::min(name.find('='), name.size()));
    throw InputError(command + ": unknown option --" + name + Nearest(name, all) + " (see " + command + " -h)");
  } catch (const po::error& error) {
    throw InputError(command + ": " + error.what() + " (see " + command + " -h)");
  }
  return true;
}

template <typename Options>
bool ParseAndCheck(int argc, char** argv, const std::string& command, const char* summary, Options* options) {
  std::string project_path;
  if (!Parse(argc, argv, "colmap " + command, Describe(summary, options, &project_path))) return false;
  CheckOptions(options);
  return true;
}

}  // namespace

std::string ProgramVersion() { return "colmap_lazyloc " LAZYLOC_VERSION ", " + ColmapVersion(); }

bool ParseCommandLine(int argc, char** argv, CommandOptions* options) {
  return ParseAndCheck(argc, argv, "lazy_localizer",
                       "colmap lazy_localizer: localizes photos against posed database images, without a 3D map.",
                       options);
}

bool ParseCommandLine(int argc, char** argv, IndexerOptions* options) {
  return ParseAndCheck(argc, argv, "lazy_indexer",
                       "colmap lazy_indexer: makes or updates the index in which colmap lazy_localizer finds the "
                       "database images that look like a photo.",
                       options);
}

bool ParseCommandLine(int argc, char** argv, MergerOptions* options) {
  return ParseAndCheck(argc, argv, "lazy_merger",
                       "colmap lazy_merger: joins the results of all shards of a colmap lazy_localizer run.", options);
}

bool ParseCommandLine(int argc, char** argv, EpochCommandOptions* options) {
  return ParseAndCheck(argc, argv, "lazy_epoch",
                       "colmap lazy_epoch: adjusts the poses of new photos together, after colmap lazy_localizer has "
                       "localized these photos; the poses of the database images do not change.",
                       options);
}

std::vector<std::tuple<std::string, std::string, std::string>> ListSettings() {
  std::vector<std::tuple<std::string, std::string, std::string>> settings;
  CommandOptions defaults;
  ForEachOption(defaults, [&](const std::string& name, const auto* value, const char* help,
                              OptionRole role = OptionRole::METHOD) {
    if (role != OptionRole::OUTPUT && role != OptionRole::START) settings.emplace_back(name, AsText(*value), help);
  });
  return settings;
}

void ParseSettings(const OptionTexts& settings, CommandOptions* options) {
  std::vector<std::string> words = {"lazy_localizer"};
  for (const auto& [name, value] : settings) words.push_back("--" + name + "=" + value);
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  std::string project_path;
  if (!Parse(static_cast<int>(argv.size()), argv.data(), "colmap lazy_localizer",
             Describe("", options, &project_path))) {
    throw InputError("help is not a setting");
  }
  CheckValues(options);
}

OptionTexts OptionsWith(const CommandOptions& options, const std::set<OptionRole>& roles) {
  OptionTexts texts;
  ForEachOption(options,
                [&](const std::string& name, const auto* value, const char*, OptionRole role = OptionRole::METHOD) {
                  if (roles.count(role) > 0) texts.emplace_back(name, AsText(*value));
                });
  return texts;
}

std::string OptionsAsIni(const CommandOptions& options) {
  const std::set<OptionRole> roles = {OptionRole::METHOD, OptionRole::INPUT, OptionRole::MACHINE, OptionRole::OUTPUT};
  const OptionTexts texts = OptionsWith(options, roles), defaults = OptionsWith(CommandOptions(), roles);
  std::string changed;
  std::vector<std::pair<std::string, std::string>> sections = {{"", ""}};  // name and lines
  for (size_t i = 0; i < texts.size(); ++i) {
    const auto& [name, value] = texts[i];
    const size_t dot = name.rfind('.');
    const std::string section_name = dot == std::string::npos ? "" : name.substr(0, dot);
    auto section =
        std::find_if(sections.begin(), sections.end(), [&](const auto& other) { return other.first == section_name; });
    if (section == sections.end()) section = sections.insert(section, {section_name, "[" + section_name + "]\n"});
    section->second += name.substr(dot + 1) + "=" + value + "\n";
    if (value != defaults[i].second) changed += " " + name;
  }
  std::string ini = changed.empty() ? "" : "# not defaults:" + changed + "\n";
  for (const auto& [name, lines] : sections) ini += lines;
  return ini;
}

}  // namespace lazyloc
