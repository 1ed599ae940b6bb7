#pragma once

#include "colmap_lazyloc/options/options.h"

// The one list of the options of colmap lazy_localizer: parsing, help, options.ini and the manifest of a run are made
// from it. Each function calls `add(name, pointer to the value, help, role)` for its options; without a role it is
// OptionRole::METHOD.
namespace lazyloc {

template <typename Options, typename Add>
void ForEachFileOption(Options& o, const Add& add) {
  add("database_path", &o.source.database_path, "COLMAP database with keypoints and matches; opened read-only",
      OptionRole::INPUT);
  add("input_path", &o.source.input_path,
      "Folder of a COLMAP model (text or binary); its posed images are the database images", OptionRole::INPUT);
  add("output_path", &o.output_path, "Folder for poses.txt, positions.csv, results.jsonl, model/ and options.ini",
      OptionRole::OUTPUT);
  add("query_list_path", &o.source.selection.query_list_path,
      "File with one query per line: its name, or hloc's `name MODEL width height params...`; default: every image of "
      "the database file without a pose in --input_path",
      OptionRole::INPUT);
  add("pairs_path", &o.source.selection.pairs_path,
      "File with the pairs to use, two image names per line; default: all pairs with matches in the database",
      OptionRole::INPUT);
  add("image_path", &o.source.photos.image_path,
      "Folder of the photos; a query without keypoints in the database is a photo, whose features are extracted and "
      "matched in memory",
      OptionRole::MACHINE);
  add("retrieval_index_path", &o.source.photos.retrieval_index_path,
      "Index of colmap lazy_indexer for finding the database images that look like a photo; made or updated if needed; "
      "default: an index in memory if there are more than 50 database images",
      OptionRole::INPUT);
  add("onnx_path", &o.source.photos.features.aliked.onnx_path,
      "Folder of COLMAP 4's ONNX models: photos are matched by ALIKED features if the database has these, or if its own do "
      "not localize them (at night, for example)",
      OptionRole::INPUT);
  add("rig_config_path", &o.source.selection.groups.rig_config_path,
      "Camera rigs of the images in the JSON format of COLMAP's rig_configurator; default: the rigs in the database or "
      "model",
      OptionRole::INPUT);
  add("query_trajectory_path", &o.source.selection.groups.trajectory_path,
      "Poses of the queries relative to each other: a COLMAP model, or a file in TUM's format or that of poses.txt; "
      "each group (without a group option, all queries) is localized as one rigid body",
      OptionRole::INPUT);
  add("query_position_path", &o.source.priors.position_path,
      "File with lines `name x y z stddev` (or three standard deviations, or six numbers of a covariance): where the "
      "cameras of queries are, from GPS for example; a position that the images contradict is left out",
      OptionRole::INPUT);
  add("query_gravity_path", &o.source.priors.gravity_path,
      "File with lines `name gx gy gz stddev_deg`: where down is in the axes of queries, from an accelerometer for "
      "example; a direction that the images contradict is left out",
      OptionRole::INPUT);
  add("depth_path", &o.source.depth.depth_path,
      "Folder of depth maps of the database images, by the images' names: 16-bit PNG, .npy, or .bin of COLMAP's dense "
      "stereo; default: no depth",
      OptionRole::INPUT);
}

template <typename Options, typename Add>
void ForEachBasicOption(Options& o, const Add& add) {
  ForEachFileOption(o, add);
  add("strict", &o.strict, "Exit with code 2 if a query was not localized", OptionRole::OUTPUT);
  add("resume", &o.resume, "Go on with an unfinished run in --output_path, or begin one", OptionRole::START);
  add("overwrite", &o.overwrite, "Remove an unfinished run in --output_path and start anew", OptionRole::START);
  add("shard", &o.shard,
      "Part of the queries, for example 17/256: the 17th of 256 shards, which colmap lazy_merger joins; default: all",
      OptionRole::OUTPUT);
  add("log_path", &o.log_path, "File for one line of JSON for each finished query; --resume 1 appends to it",
      OptionRole::OUTPUT);
  add("ImageReader.camera_params", &o.source.photos.camera_params,
      "Parameters of the camera model of photos without a camera of their own, separated by commas; default: a camera of "
      "the database with the photo's size, else the focal length in EXIF, else a guess");
  add("ImageReader.single_camera", &o.source.single_camera,
      "Queries of the same size whose intrinsics nobody has stated were taken by one camera with one zoom, which is "
      "estimated from up to 20 of them together and written to options.ini; not for groups, rigs and trajectories");
  add("LazyLocalizer.num_retrieved", &o.source.num_retrieved,
      "Number of database images per query, those with the most verified inliers; with --pairs_path all listed ones "
      "are used");
  add("LazyLocalizer.method", &o.localizer.method,
      "Method: extended, or for comparison paper (LazyLoc as published: one start, one bundle adjustment by Ceres, exact "
      "database poses, each query individually)");
  add("LazyLocalizer.num_threads", &o.num_threads, "Number of threads; -1 uses all cores", OptionRole::MACHINE);
  add("LazyLocalizer.seed", &o.localizer.seed, "Seed of all random choices; the same seed gives the same result");
  add("LazyLocalizer.group_size", &o.source.selection.groups.group_size,
      "Number of consecutive queries of the list (with rigs: of frames) that are localized together");
  add("LazyLocalizer.leave_one_out", &o.source.selection.leave_one_out,
      "Localize each posed image (or each of --query_list_path) against all others");
  add("LazyLocalizer.intrinsics", &o.localizer.intrinsics,
      "Intrinsics of queries: auto (estimate a focal length that is a guess, EXIF's or another image's; refuse a query "
      "whose given intrinsics the images contradict), given (keep them and only warn) or refine (always estimate the "
      "focal length)");
  add("LazyLocalizer.world_up", &o.source.priors.world_up,
      "Direction against gravity in the model, for example 0,0,1; needed for --query_gravity_path");
  add("LazyLocalizer.depth_is_metric", &o.localizer.depth_is_metric,
      "Take depths in --depth_path as lengths in the unit of the model, even if no triangulated points confirm their "
      "scale");
  add("LazyLocalizer.min_confidence", &o.localizer.min_confidence,
      "Minimum probability that a position is right; queries below it have the status LOW_CONFIDENCE");
}

template <typename Options, typename Add>
void ForEachSourceOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.group_list_path", &o.selection.groups.group_list_path,
      "File with one group of queries per line, by image names; a group is localized together", OptionRole::INPUT);
  add("LazyLocalizer.Advanced.use_rigs", &o.selection.groups.use_rigs,
      "Use camera rigs: localize the images of a frame together");
  add("LazyLocalizer.Advanced.trajectory_has_scale", &o.selection.groups.trajectory_has_scale,
      "Take lengths in --query_trajectory_path as lengths in the unit of the model; 0 estimates their scale for each "
      "group");
  add("LazyLocalizer.Advanced.depth_png_unit", &o.depth.png_unit,
      "Depth in the unit of the model for a value of 1 in a PNG of --depth_path");
  add("LazyLocalizer.Advanced.on_demand", &o.photos.on_demand,
      "Extract the SIFT features of a database image when a photo needs them, from its own photo below --image_path, if "
      "the database does not have them; retrieval then uses coarse features of these photos; both are kept beside the "
      "index");
  add("LazyLocalizer.Advanced.matches_output_path", &o.photos.matches_output_path,
      "New COLMAP database for the photos' features and matches; the file must not exist", OptionRole::OUTPUT);
  add("LazyLocalizer.Advanced.cache_gb", &o.photos.cache_gb,
      "Memory in gigabytes for the features of database images that photos are matched with", OptionRole::MACHINE);
}

template <typename Options, typename Add>
void ForEachMethodOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.rig_noise_px", &o.rig_noise_px,
      "Expected error of the relative poses of a rig or trajectory, as displacement of keypoints. 0: exact");
  add("LazyLocalizer.Advanced.database_pose_stddev_deg", &o.database_pose_stddev_deg,
      "Standard deviation of the database images' rotations in degrees; 0 for both deviations keeps the poses constant, "
      "-1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.database_pose_stddev_length", &o.database_pose_stddev_length,
      "Standard deviation of the database images' positions in database units; 0 for both deviations keeps the poses "
      "constant, -1 for both estimates their errors for each query");
  add("LazyLocalizer.Advanced.focal_length_stddev_ratio", &o.focal_length_stddev_ratio,
      "Standard deviation of a given focal length, as a fraction of it; 0 leaves it out of the covariance");
}

template <typename Options, typename Add>
void ForEachFeatureOption(Options& o, const Add& add) {
  add("ImageReader.camera_model", &o.camera_model, "Camera model of photos without a known camera");
  auto& extraction = o.features.sift;
  add("SiftExtraction.max_image_size", &extraction.max_image_size,
      "Maximum size of a photo in pixels; a larger one is scaled down for extraction");
  add("SiftExtraction.max_num_features", &extraction.max_num_features,
      "Maximum number of features of a photo; those of the largest scales are kept; -1: as many as 95 % of the database "
      "images have at most");
  add("SiftExtraction.first_octave", &extraction.first_octave,
      "First octave of the image pyramid; -1 doubles the size of a photo, 0 does not; -2: the first one that the scales of "
      "the database images' keypoints need");
  add("SiftExtraction.estimate_affine_shape", &extraction.estimate_affine_shape,
      "Estimate ellipses instead of circles as feature shapes");
  add("SiftExtraction.domain_size_pooling", &extraction.domain_size_pooling, "Pool descriptors over several scales");
  add("SiftExtraction.upright", &extraction.upright, "Assume that photos are upright: fix the features' orientation");
  add("AlikedExtraction.max_num_features", &o.features.aliked.max_num_features,
      "Maximum number of ALIKED features of a photo; those of the highest scores are kept");
  add("FeatureMatching.type", &o.features.matcher,
      "How photos are matched: SIFT_BRUTEFORCE, ALIKED_BRUTEFORCE or ALIKED_LIGHTGLUE, which takes seconds per pair and "
      "bridges larger changes of light and viewpoint; AUTO: the database's features by brute force, and photos that this "
      "does not localize again by ALIKED_LIGHTGLUE if --onnx_path is given");
}

template <typename Options, typename Add>
void ForEachAdvancedOption(Options& o, const Add& add) {
  ForEachSourceOption(o.source, add);
  ForEachMethodOption(o.localizer, add);
  ForEachFeatureOption(o.source.photos, add);
}

template <typename Options, typename Add>
void ForEachOption(Options& o, const Add& add) {
  ForEachBasicOption(o, add);
  ForEachAdvancedOption(o, add);
}

}  // namespace lazyloc
