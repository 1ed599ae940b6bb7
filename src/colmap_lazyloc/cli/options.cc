#include "colmap_lazyloc/cli/options.h"

#include <fstream>
#include <iostream>
#include <sstream>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

namespace po = boost::program_options;

// How Boost reads an option that is an enum, by the name of its value. (It finds this by the enum's namespace.)
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

namespace {

// JSON's form of a number is its shortest exact one.
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

// Hands each option to `add(name, pointer to its value, help)`: the one list of them, for parsing, help and options.ini.
template <typename Options, typename Add>
void ForEachOption(Options& o, const Add& add) {
  add("database_path", &o.database_path, "COLMAP database with keypoints and matches; opened read-only");
  add("input_path", &o.input_path, "folder of a COLMAP model (text or binary): its posed images are the database");
  add("output_path", &o.output_path, "folder for poses.txt, results.jsonl, model/ and options.ini");
  add("query_list_path", &o.query_list_path,
      "queries, one name a line or hloc's `name MODEL width height params...`; "
      "default: every image of the database file without a pose in --input_path");
  add("pairs_path", &o.pairs_path, "pairs to use, two names a line; default: those that the database has matches for");
  add("strict", &o.strict, "exit with code 2 if a query was not localized");
  add("LazyLocalizer.num_retrieved", &o.loader.num_retrieved,
      "database images per query, best by verified inliers; with --pairs_path all listed ones are used");
  add("LazyLocalizer.num_threads", &o.num_threads, "queries at a time; -1 for the number of cores");
  add("LazyLocalizer.use_database_matches", &o.loader.use_database_matches,
      "extend the query's tracks by the verified matches among its database images that the database holds");
  add("LazyLocalizer.leave_one_out", &o.loader.leave_one_out,
      "localize every posed image (or those of --query_list_path) against all others");
  add("LazyLocalizer.seed", &o.localizer.seed, "seed of the random choices; results depend on no other chance");
  add("LazyLocalizer.min_num_inliers", &o.localizer.relative_pose.min_num_inliers,
      "a pair with fewer verified inliers is not used");
  add("LazyLocalizer.max_two_view_error_px", &o.localizer.relative_pose.max_two_view_error_px,
      "largest epipolar error of an inlier in pixels, where no two-view geometry is stored");
  add("LazyLocalizer.max_rotation_error_deg", &o.localizer.max_rotation_error_deg,
      "a pair whose rotation is off the averaged one by more degrees is dropped");
  add("LazyLocalizer.rotation_averaging", &o.localizer.rotation_averaging.method,
      "how rotations are averaged: l1_irls, l1 or quaternion_mean (the last two for comparison)");
  add("LazyLocalizer.num_l1_iterations", &o.localizer.rotation_averaging.num_l1_iterations,
      "most steps of rotation averaging under the L1 norm");
  add("LazyLocalizer.num_irls_iterations", &o.localizer.rotation_averaging.num_irls_iterations,
      "most steps of rotation averaging with robust weights, after those");
  add("LazyLocalizer.irls_scale_deg", &o.localizer.rotation_averaging.irls_scale_deg,
      "scale in degrees of rotation averaging's robust weights");
  add("LazyLocalizer.translation_averaging", &o.localizer.translation_averaging.method,
      "how positions are averaged: angular, or lud (least unsquared deviations, for comparison)");
  add("LazyLocalizer.min_direction_stddev_deg", &o.localizer.translation_averaging.min_direction_stddev_deg,
      "noise floor in degrees of each pair's direction in translation averaging");
  add("LazyLocalizer.start_pose", &o.localizer.start_pose,
      "where bundle adjustment starts from: best, motion_averaging, absolute_pose or generalized_relative_pose");
  add("LazyLocalizer.post_optimization", &o.localizer.post_optimization,
      "what follows motion averaging: tracks, or for comparison sampson, relative_pose_lo or none (without covariance)");
  add("LazyLocalizer.use_raw_matches", &o.localizer.use_raw_matches,
      "after each round, collect the inliers again from all raw matches");
  add("LazyLocalizer.min_triangulation_angle_deg", &o.localizer.triangulation.min_triangulation_angle_deg,
      "smallest angle in degrees under which a point must be seen");
  add("LazyLocalizer.max_database_error_sigma", &o.localizer.triangulation.max_database_error_sigma,
      "largest reprojection error of a point in a database image, in standard deviations of the image's noise");
  add("LazyLocalizer.max_query_error_sigma", &o.localizer.triangulation.max_query_error_sigma,
      "largest reprojection error of a point in the query, in standard deviations, after the first round");
  add("LazyLocalizer.max_start_error_sigma", &o.localizer.max_start_error_sigma,
      "the same in the first round, whose start may be off by many pixels");
  add("LazyLocalizer.start_noise_px", &o.localizer.start_noise_px,
      "image noise in pixels that the first round assumes");
  add("LazyLocalizer.min_noise_px", &o.localizer.min_noise_px,
      "smallest image noise in pixels that later rounds estimate");
  add("LazyLocalizer.num_refinement_rounds", &o.localizer.num_refinement_rounds,
      "rounds of triangulation and bundle adjustment");
  add("LazyLocalizer.loss_scale_sigma", &o.localizer.bundle_adjustment.loss_scale_sigma,
      "Cauchy scale of bundle adjustment in standard deviations of the image noise");
  add("LazyLocalizer.single_view_noise_ratio", &o.localizer.triangulation.single_view_noise_ratio,
      "factor on the image noise of points that one database image sees");
  add("LazyLocalizer.max_num_tracks", &o.localizer.max_num_tracks,
      "of more tracks than these, well distributed ones with most image points are used");
  add("LazyLocalizer.max_num_start_tracks", &o.localizer.max_num_start_tracks,
      "the same for the start and all rounds but the last");
  add("LazyLocalizer.refine_focal_length", &o.localizer.refine_focal_length,
      "find the focal length of queries whose camera has no prior focal length in the database");
  add("LazyLocalizer.database_pose_stddev_deg", &o.localizer.database_pose_stddev_deg,
      "standard deviation of the database images' rotations about each axis in degrees; 0 takes them as exact, -1 "
      "estimates it for each query");
  add("LazyLocalizer.database_pose_stddev_length", &o.localizer.database_pose_stddev_length,
      "standard deviation of each coordinate of the database images' positions in database units; 0 and -1 as above");
  add("LazyLocalizer.database_pose_noise_px", &o.localizer.database_pose_noise_px,
      "what the estimate of these two expects, in pixels by which the pose errors displace image points");
  add("LazyLocalizer.min_num_tracks", &o.localizer.min_num_tracks, "fewest tracks that a pose may rest on");
  add("LazyLocalizer.max_position_stddev_ratio", &o.localizer.max_position_stddev_ratio,
      "a position less certain than this part of the distance to the scene is not reported as found "
      "(by its standard deviation)");
}

// Collects what is no option, so that a message can name it.
constexpr const char* kStrayArguments = "stray-arguments";

po::options_description Describe(CommandOptions* options, std::string* project_path) {
  po::options_description description(
      "colmap lazy_localizer: where were photos taken, given posed database images and no 3D map.\n"
      "Options (of a switch: 0 or 1; default in brackets)");
  auto add_option = description.add_options();
  add_option("help,h", "print this help");
  add_option("project_path", po::value(project_path), ".ini file with any of these options; the command line wins");
  ForEachOption(*options, [&](const char* name, auto* value, const char* help) {
    add_option(name, po::value(value)->default_value(*value, AsText(*value)), help);
  });
  return description;
}

void CheckOptions(const CommandOptions& options) {
  for (const auto& [name, value] :
       {std::pair{"database_path", &options.database_path}, std::pair{"input_path", &options.input_path},
        std::pair{"output_path", &options.output_path}}) {
    if (value->empty()) throw InputError("option --" + std::string(name) + " is required but missing");
  }
  if (options.loader.num_retrieved < 1) throw InputError("option --LazyLocalizer.num_retrieved must be >= 1");
  if (options.num_threads < 1 && options.num_threads != -1) {
    throw InputError("option --LazyLocalizer.num_threads must be >= 1, or -1");
  }
  std::string error;
  if (!options.localizer.Check(&error)) throw InputError("option --LazyLocalizer." + error);
}

}  // namespace

bool ParseCommandLine(int argc, char** argv, CommandOptions* options) {
  std::string project_path;
  po::options_description description = Describe(options, &project_path);
  po::options_description with_stray_arguments(description);
  with_stray_arguments.add_options()(kStrayArguments, po::value<std::vector<std::string>>());
  po::variables_map values;
  try {
    po::store(po::command_line_parser(argc, argv)
                  .options(with_stray_arguments)
                  .positional(po::positional_options_description().add(kStrayArguments, -1))
                  .style(po::command_line_style::default_style & ~po::command_line_style::allow_guessing)
                  .run(),
              values);
    if (values.count("help") > 0) {
      std::cout << description << std::endl;
      return false;
    }
    if (values.count(kStrayArguments) > 0) {
      throw InputError("colmap lazy_localizer: `" + values[kStrayArguments].as<std::vector<std::string>>().front() +
                       "` is no option (see colmap lazy_localizer -h)");
    }
    if (values.count("project_path") > 0) {
      std::ifstream file(values["project_path"].as<std::string>());
      if (!file) throw InputError("--project_path: cannot read " + values["project_path"].as<std::string>());
      po::store(po::parse_config_file(file, description), values);
    }
    po::notify(values);
  } catch (const po::error& error) {
    throw InputError(std::string("colmap lazy_localizer: ") + error.what() + " (see colmap lazy_localizer -h)");
  }
  CheckOptions(*options);
  options->localizer.max_num_pairs = options->pairs_path.empty() ? options->loader.num_retrieved : 0;
  options->loader.use_raw_matches = options->localizer.use_raw_matches;
  return true;
}

std::string OptionsAsIni(const CommandOptions& options) {
  std::ostringstream ini;
  std::string section;
  ForEachOption(options, [&](const std::string& name, const auto* value, const char*) {
    const size_t dot = name.find('.');
    const std::string own_section = dot == std::string::npos ? "" : name.substr(0, dot);
    if (own_section != section) ini << '[' << (section = own_section) << "]\n";
    ini << (dot == std::string::npos ? name : name.substr(dot + 1)) << '=';
    ini << AsText(*value) << '\n';
  });
  return ini.str();
}

}  // namespace lazyloc
