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

constexpr const char* kNumVisualWordsHelp =
    "most words of the retrieval index's vocabulary; small databases have fewer";

// Of what is done with photos.
template <typename Options, typename Add>
void ForEachPhotoOption(Options& o, const Add& add) {
  add("LazyIndexer.num_visual_words", &o.retrieval.num_visual_words, kNumVisualWordsHelp);
  add("ImageReader.camera_model", &o.camera_model, "camera model of photos that --query_list_path gives none for");
  add("ImageReader.camera_params", &o.camera_params,
      "their parameters, numbers with commas between; default: focal length from EXIF");
  add("SiftExtraction.max_image_size", &o.matching.extraction.max_image_size,
      "photos larger than this number of pixels are scaled down for extraction");
  add("SiftExtraction.max_num_features", &o.matching.extraction.max_num_features,
      "most features of a photo, those of the largest scales");
  add("SiftExtraction.first_octave", &o.matching.extraction.first_octave,
      "-1 doubles a photo's size before extraction, 0 does not");
  add("SiftExtraction.peak_threshold", &o.matching.extraction.peak_threshold, "smallest contrast of a feature");
  add("SiftExtraction.edge_threshold", &o.matching.extraction.edge_threshold,
      "largest ratio of a feature's curvatures");
  add("SiftExtraction.estimate_affine_shape", &o.matching.extraction.estimate_affine_shape,
      "extract ellipses instead of circles");
  add("SiftExtraction.domain_size_pooling", &o.matching.extraction.domain_size_pooling,
      "pool descriptors over several scales");
  add("SiftExtraction.upright", &o.matching.extraction.upright, "take features for upright");
  add("SiftMatching.max_ratio", &o.matching.matching.max_ratio,
      "largest ratio of the distances to the best and the second best match");
  add("SiftMatching.max_distance", &o.matching.matching.max_distance,
      "largest angle in rad between matched descriptors");
  add("SiftMatching.cross_check", &o.matching.matching.cross_check, "match only what is best both ways");
}

// Hands each option to `add(name, pointer to its value, help)`: the one list of them, for parsing, help and
// options.ini.
template <typename Options, typename Add>
void ForEachOption(Options& o, const Add& add) {
  add("database_path", &o.database_path, "COLMAP database with keypoints and matches; opened read-only");
  add("input_path", &o.input_path, "folder of a COLMAP model (text or binary): its posed images are the database");
  add("output_path", &o.output_path, "folder for poses.txt, results.jsonl, model/ and options.ini");
  add("query_list_path", &o.query_list_path,
      "queries, one name a line or hloc's `name MODEL width height params...`; "
      "default: every image of the database file without a pose in --input_path");
  add("pairs_path", &o.pairs_path, "pairs to use, two names a line; default: those that the database has matches for");
  add("rig_config_path", &o.rig_config_path,
      "camera rigs of the queries in COLMAP's JSON form (as for rig_configurator); default: those in the database or model");
  add("group_list_path", &o.group_list_path, "queries to localize together, names of one group a line");
  add("query_trajectory_path", &o.query_trajectory_path,
      "poses of the queries relative to each other: a COLMAP model, or a file in TUM's form or that of "
      "poses.txt; each group is localized as one rigid body, all queries where no group is set");
  add("image_path", &o.photos.image_path,
      "folder of the photos of queries that have no keypoints in the database; their features are extracted and matched "
      "in memory");
  add("retrieval_index_path", &o.photos.retrieval_index_path,
      "index of colmap lazy_indexer, by which the database images for a photo are chosen; made or refreshed where needed; "
      "default: an index in memory where there are more images than max_num_exhaustive");
  add("query_prior_path", &o.photos.query_prior_path,
      "`name x y z radius` a line: a photo is compared with database images within the radius only");
  add("strict", &o.strict, "exit with code 2 if a query was not localized");
  add("LazyLocalizer.num_retrieved", &o.loader.num_retrieved,
      "database images per query, best by verified inliers; with --pairs_path all listed ones are used");
  add("LazyLocalizer.num_threads", &o.num_threads, "queries at a time; -1 for the number of cores");
  add("LazyLocalizer.leave_one_out", &o.loader.leave_one_out,
      "localize every posed image (or those of --query_list_path) against all others");
  add("LazyLocalizer.use_rigs", &o.loader.groups.use_rigs, "localize the images of a rig's frame as one");
  add("LazyLocalizer.group_size", &o.loader.groups.group_size,
      "localize so many consecutive queries (frames, with rigs) of the list together");
  add("LazyLocalizer.trajectory_has_scale", &o.loader.groups.trajectory_has_scale,
      "lengths of --query_trajectory_path are in the model's unit; 0 finds their scale for each group");
  add("LazyLocalizer.matches_output_path", &o.matches_output_path,
      "new COLMAP database for the photos' features and matches; it must not exist yet");
  add("LazyLocalizer.max_num_exhaustive", &o.photos.matching.max_num_exhaustive,
      "up to as many database images are all matched with a photo, without retrieval");
  add("LazyLocalizer.cache_gb", &o.photos.matching.cache_gb,
      "memory in gigabytes for features of database images that photos are matched with");
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
  add("LazyLocalizer.convergence_sigma", &o.localizer.bundle_adjustment.convergence_sigma,
      "bundle adjustment ends with the step that moves the poses by less, in standard deviations (root mean "
      "square over the poses)");
  add("LazyLocalizer.single_view_noise_ratio", &o.localizer.triangulation.single_image_noise_ratio,
      "factor on the image noise of points that one database image sees; more where these scatter more than others");
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
  ForEachPhotoOption(o.photos, add);
}

template <typename Add>
void ForEachOption(IndexerOptions& o, const Add& add) {
  add("database_path", &o.database_path, "COLMAP database with SIFT descriptors; opened read-only");
  add("index_path", &o.index_path, "file of the index; where it exists, it is brought up to date");
  add("LazyIndexer.num_visual_words", &o.retrieval.num_visual_words, kNumVisualWordsHelp);
  add("LazyIndexer.num_threads", &o.retrieval.num_threads, "-1 for the number of cores");
}

// Collects what is no option, so that a message can name it.
constexpr const char* kStrayArguments = "stray-arguments";

template <typename Options>
po::options_description Describe(const char* summary, Options* options, std::string* project_path) {
  po::options_description description(std::string(summary) + "\nOptions (of a switch: 0 or 1; default in brackets)");
  auto add_option = description.add_options();
  add_option("help,h", "print this help");
  add_option("project_path", po::value(project_path), ".ini file with any of these options; the command line wins");
  ForEachOption(*options, [&](const char* name, auto* value, const char* help) {
    add_option(name, po::value(value)->default_value(*value, AsText(*value)), help);
  });
  return description;
}

void CheckRequired(std::initializer_list<std::pair<const char*, const std::string*>> options) {
  for (const auto& [name, value] : options) {
    if (value->empty()) throw InputError("option --" + std::string(name) + " is required but missing");
  }
}

void CheckPhotoOptions(const CommandOptions& options) {
  if (options.photos.image_path.empty()) {
    for (const auto& [name, value] : {std::pair{"retrieval_index_path", &options.photos.retrieval_index_path},
                                      std::pair{"query_prior_path", &options.photos.query_prior_path},
                                      std::pair{"LazyLocalizer.matches_output_path", &options.matches_output_path}}) {
      if (!value->empty()) throw InputError("option --" + std::string(name) + " is for photos, and needs --image_path");
    }
  } else if (options.loader.leave_one_out) {
    throw InputError("options --image_path and --LazyLocalizer.leave_one_out exclude each other");
  }
  std::string error;
  if (!options.photos.Check(&error)) throw InputError("option " + error);
}

void CheckOptions(const CommandOptions& options) {
  CheckRequired({{"database_path", &options.database_path},
                 {"input_path", &options.input_path},
                 {"output_path", &options.output_path}});
  if (options.loader.num_retrieved < 1) throw InputError("option --LazyLocalizer.num_retrieved must be >= 1");
  if (options.num_threads < 1 && options.num_threads != -1) {
    throw InputError("option --LazyLocalizer.num_threads must be >= 1, or -1");
  }
  if (options.loader.groups.group_size < 1) throw InputError("option --LazyLocalizer.group_size must be >= 1");
  std::string error;
  if (!options.localizer.Check(&error)) throw InputError("option --LazyLocalizer." + error);
  CheckPhotoOptions(options);
}

// Fills the variables that the description names. Returns false where only the help was asked for and printed.
bool Parse(int argc, char** argv, const std::string& command, const po::options_description& description) {
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
      throw InputError(command + ": `" + values[kStrayArguments].as<std::vector<std::string>>().front() +
                       "` is no option (see " + command + " -h)");
    }
    if (values.count("project_path") > 0) {
      std::ifstream file(values["project_path"].as<std::string>());
      if (!file) throw InputError("--project_path: cannot read " + values["project_path"].as<std::string>());
      po::store(po::parse_config_file(file, description), values);
    }
    po::notify(values);
  } catch (const po::error& error) {
    throw InputError(command + ": " + error.what() + " (see " + command + " -h)");
  }
  return true;
}

}  // namespace

bool ParseCommandLine(int argc, char** argv, CommandOptions* options) {
  std::string project_path;
  const auto description =
      Describe("colmap lazy_localizer: where were photos taken, given posed database images and no 3D map.", options,
               &project_path);
  if (!Parse(argc, argv, "colmap lazy_localizer", description)) return false;
  CheckOptions(*options);
  options->localizer.max_num_pairs = options->pairs_path.empty() ? options->loader.num_retrieved : 0;
  options->loader.has_photos = !options->photos.image_path.empty();
  options->photos.retrieval.seed = options->localizer.seed;
  options->photos.retrieval.num_threads = options->num_threads;
  options->loader.groups.rig_config_path = options->rig_config_path;
  options->loader.groups.group_list_path = options->group_list_path;
  options->loader.groups.trajectory_path = options->query_trajectory_path;
  return true;
}

bool ParseCommandLine(int argc, char** argv, IndexerOptions* options) {
  std::string project_path;
  const auto description = Describe(
      "colmap lazy_indexer: makes or refreshes the index by which colmap lazy_localizer finds the database images that "
      "look like a photo.",
      options, &project_path);
  if (!Parse(argc, argv, "colmap lazy_indexer", description)) return false;
  CheckRequired({{"database_path", &options->database_path}, {"index_path", &options->index_path}});
  std::string error;
  if (!options->retrieval.Check(&error)) throw InputError("option --LazyIndexer." + error);
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
