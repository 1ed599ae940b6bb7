#pragma once

#include "colmap_lazyloc/cli/options.h"

// The options that name files and folders of a run, as option_list.h says.
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
  add("onnx_path", &o.source.photos.aliked.onnx_path,
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

}  // namespace lazyloc
