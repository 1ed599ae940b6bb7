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
  add("output_path", &o.output_path,
      "Folder for the results: poses.txt, positions.csv, results.jsonl, model/ and options.ini", OptionRole::OUTPUT);
  add("query_list_path", &o.source.selection.query_list_path,
      "File with one query per line: `name`, or `name MODEL width height params...` as in hloc; default: all images "
      "in the database that have no pose in the model",
      OptionRole::INPUT);
  add("pairs_path", &o.source.selection.pairs_path,
      "File with the image pairs to use, two names per line; default: all pairs with matches in the database",
      OptionRole::INPUT);
  add("image_path", &o.source.photos.image_path,
      "Folder of the photos. If a query has no keypoints in the database, the program extracts its features from the "
      "photo and matches them",
      OptionRole::MACHINE);
  add("retrieval_index_path", &o.source.photos.retrieval_index_path,
      "File of the visual index, which finds the database images that look like a photo; created or updated if "
      "needed; default: in memory, if there are more than 50 database images",
      OptionRole::INPUT);
  add("onnx_path", &o.source.photos.features.aliked.onnx_path,
      "Folder of COLMAP 4's ONNX models for ALIKED features. The program uses ALIKED features if the database contains "
      "them, or if a photo is not localized with SIFT features (for example at night)",
      OptionRole::INPUT);
  add("rig_config_path", &o.source.selection.groups.rig_config_path,
      "Camera rigs in the JSON format of COLMAP's rig_configurator; default: the rigs in the database or model",
      OptionRole::INPUT);
  add("query_trajectory_path", &o.source.selection.groups.trajectory_path,
      "Relative poses of the queries, for example from odometry: a COLMAP model, a file in TUM's format, or a file "
      "like poses.txt. Each group of queries (by default, all queries) is localized as one rigid body",
      OptionRole::INPUT);
  add("query_position_path", &o.source.priors.position_path,
      "Rough positions of the queries, for example from GPS: lines `name x y z stddev`; instead of stddev, a line may "
      "have three standard deviations or a covariance (six numbers). A position that contradicts the images is not "
      "used",
      OptionRole::INPUT);
  add("query_gravity_path", &o.source.priors.gravity_path,
      "Direction of gravity in the camera axes of the queries, for example from an accelerometer: lines `name gx gy "
      "gz stddev_deg`. A direction that contradicts the images is not used",
      OptionRole::INPUT);
  add("depth_path", &o.source.depth.depth_path,
      "Folder of depth maps with the names of the database images: 16-bit PNG, .npy, or .bin files of COLMAP's dense "
      "stereo",
      OptionRole::INPUT);
}

template <typename Options, typename Add>
void ForEachBasicOption(Options& o, const Add& add) {
  ForEachFileOption(o, add);
  add("strict", &o.strict, "Exit with code 2 if any query was not localized", OptionRole::OUTPUT);
  add("resume", &o.resume, "Continue the unfinished run in --output_path, or start a run if there is none",
      OptionRole::START);
  add("overwrite", &o.overwrite, "Delete the unfinished run in --output_path and start anew", OptionRole::START);
  add("shard", &o.shard,
      "Part of the queries to localize, for example 17/256 for the 17th of 256 shards; colmap lazy_merger joins the "
      "results",
      OptionRole::OUTPUT);
  add("log_path", &o.log_path,
      "File to which one line of JSON is written for each finished query; --resume 1 appends lines",
      OptionRole::OUTPUT);
  add("ImageReader.camera_params", &o.source.photos.camera_params,
      "Camera parameters of photos without known intrinsics, separated by commas; default: from a database camera "
      "with the photo's size, else from EXIF, else a guess");
  add("ImageReader.single_camera", &o.source.single_camera,
      "Assume that one camera at one zoom took all queries that have the same size and no given intrinsics. The "
      "intrinsics of this camera are estimated from up to 20 queries together, and written to options.ini. No effect "
      "on groups, rigs and trajectories; default: only queries that share a camera in the database share intrinsics");
  add("ImageReader.single_camera_per_image", &o.source.single_camera_per_image,
      "Estimate the intrinsics of each query without given intrinsics individually, even if queries share a camera in "
      "the database");
  add("LazyLocalizer.num_retrieved", &o.source.num_retrieved,
      "Number of database images per query: the images with the most verified matches. With --pairs_path, all listed "
      "images are used");
  add("LazyLocalizer.method", &o.localizer.method,
      "Method of localization. extended: the method of this program. paper: the published method LazyLoc, for "
      "comparison");
  add("LazyLocalizer.num_threads", &o.num_threads, "Number of threads; -1 uses all cores", OptionRole::MACHINE);
  add("LazyLocalizer.seed", &o.localizer.seed, "Seed of all random choices; the same seed gives the same results");
  add("LazyLocalizer.group_size", &o.source.selection.groups.group_size,
      "Number of consecutive queries (with rigs: frames) that are localized together");
  add("LazyLocalizer.leave_one_out", &o.source.selection.leave_one_out,
      "Localize each posed image, or each image in --query_list_path, from all other posed images");
  add("LazyLocalizer.intrinsics", &o.localizer.intrinsics,
      "How to use the intrinsics of queries. auto: estimate the focal length if it comes from EXIF, another image or "
      "a guess; if the images contradict given intrinsics, the query is not localized. given: use the given "
      "intrinsics, and only warn if the images contradict them. refine: always estimate the focal length");
  add("LazyLocalizer.world_up", &o.source.priors.world_up,
      "Upward direction in the model, for example 0,0,1; needed for --query_gravity_path");
  add("LazyLocalizer.depth_is_metric", &o.localizer.depth_is_metric,
      "Assume that the depths in --depth_path are in the unit of the model, even if no triangulated points confirm it");
  add("LazyLocalizer.min_confidence", &o.localizer.min_confidence,
      "Minimum probability that the position is right; a query with a lower probability has the status LOW_CONFIDENCE");
}

template <typename Options, typename Add>
void ForEachSourceOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.group_list_path", &o.selection.groups.group_list_path,
      "File with the names of one group of queries per line; each group is localized together", OptionRole::INPUT);
  add("LazyLocalizer.Advanced.use_rigs", &o.selection.groups.use_rigs, "Localize the images of a rig's frame together");
  add("LazyLocalizer.Advanced.trajectory_has_scale", &o.selection.groups.trajectory_has_scale,
      "Lengths in --query_trajectory_path are in the unit of the model; 0: estimate the scale of the trajectory for "
      "each group");
  add("LazyLocalizer.Advanced.depth_png_unit", &o.depth.png_unit,
      "Depth of a pixel with the value 1 in a PNG file of --depth_path, in the unit of the model");
  add("LazyLocalizer.Advanced.on_demand", &o.photos.on_demand,
      "Extract missing SIFT features of database images from the files in --image_path when a photo is compared with "
      "these images, and store the features beside the visual index");
  add("LazyLocalizer.Advanced.photo_position_path", &o.photos.position_path,
      "Rough positions of photos, in the format of --query_position_path. They are used only to choose database "
      "images, not to compute the pose",
      OptionRole::INPUT);
  add("LazyLocalizer.Advanced.matches_output_path", &o.photos.matches_output_path,
      "New COLMAP database for the features and matches of the photos; the file must not exist", OptionRole::OUTPUT);
  add("LazyLocalizer.Advanced.cache_gb", &o.photos.cache_gb,
      "Memory for features of database images, in gigabytes; used only if photos are localized", OptionRole::MACHINE);
}

template <typename Options, typename Add>
void ForEachMethodOption(Options& o, const Add& add) {
  add("LazyLocalizer.Advanced.rig_noise_px", &o.rig_noise_px,
      "Expected error of the relative poses of a rig or trajectory, as a displacement of the keypoints in pixels; 0: "
      "the relative poses are exact");
  add("LazyLocalizer.Advanced.database_pose_stddev_deg", &o.database_pose_stddev_deg,
      "Standard deviation of the rotation errors of database images, in degrees. If this option is 0 and "
      "database_pose_stddev_length is 0, the database poses are exact; if both are -1, the pose errors are estimated "
      "for each query");
  add("LazyLocalizer.Advanced.database_pose_stddev_length", &o.database_pose_stddev_length,
      "Standard deviation of the position errors of database images, in the unit of the model; for 0 and -1, see "
      "database_pose_stddev_deg");
  add("LazyLocalizer.Advanced.focal_length_stddev_ratio", &o.focal_length_stddev_ratio,
      "Standard deviation of a given focal length, as a fraction of the focal length; 0: the pose covariance ignores "
      "errors of the focal length");
}

template <typename Options, typename Add>
void ForEachFeatureOption(Options& o, const Add& add) {
  add("ImageReader.camera_model", &o.camera_model, "Camera model of photos without known intrinsics");
  auto& extraction = o.features.sift;
  add("SiftExtraction.max_image_size", &extraction.max_image_size,
      "Maximum width and height of a photo in pixels; larger photos are scaled down for extraction");
  add("SiftExtraction.max_num_features", &extraction.max_num_features,
      "Maximum number of features per photo; the features of the largest scales are kept. With the default value, the "
      "program first uses 4000 features, and uses 8192 only if these give no pose. -1: the 95th percentile of the "
      "numbers of features of the database images");
  add("SiftExtraction.first_octave", &extraction.first_octave,
      "First octave of the image pyramid. -1: double the size of a photo; 0: keep the size; -2: choose the octave by "
      "the scales of the keypoints of the database images");
  add("SiftExtraction.estimate_affine_shape", &extraction.estimate_affine_shape,
      "Estimate elliptical instead of circular feature shapes");
  add("SiftExtraction.domain_size_pooling", &extraction.domain_size_pooling, "Pool descriptors over several scales");
  add("SiftExtraction.upright", &extraction.upright,
      "Assume that photos are upright: all features get the same orientation");
  add("AlikedExtraction.max_num_features", &o.features.aliked.max_num_features,
      "Maximum number of ALIKED features per photo; the features with the highest scores are kept");
  add("FeatureMatching.type", &o.features.matcher,
      "How photos are matched: SIFT_BRUTEFORCE, ALIKED_BRUTEFORCE, ALIKED_LIGHTGLUE or AUTO. ALIKED_LIGHTGLUE "
      "tolerates larger changes of light and viewpoint, but takes seconds per pair. AUTO matches by brute force, with "
      "the features of the database; with --onnx_path, a photo that is not localized is matched again by "
      "ALIKED_LIGHTGLUE");
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
