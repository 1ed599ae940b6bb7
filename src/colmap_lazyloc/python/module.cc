// The extension module colmap_lazyloc._core. The package's localizer.py checks what users give and calls it.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/python/conversions.h"
#include "colmap_lazyloc/python/python_localizer.h"
#include "colmap_lazyloc/python/text.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace nb = nanobind;
using nb::literals::operator""_a;

namespace lazyloc {
namespace {

using PairInput = std::tuple<std::string, std::optional<InputPoints>, InputMatches>;

// A query of any kind, which Python only hands on.
struct Query {
  QueryInput input;
  QueryPrior prior = {};
};

// Raises errors in the input as the package's InputError.
void TranslateInputError(const std::exception_ptr& error, void*) {
  try {
    std::rethrow_exception(error);
  } catch (const InputError& input_error) {
    const nb::object type = nb::module_::import_("colmap_lazyloc.errors").attr("InputError");
    PyErr_SetObject(type.ptr(), ToPython(AsOneLine(input_error.what())).ptr());
  }
}

PythonLocalizer* MakeLocalizer(const OptionTexts& settings, const std::optional<Model>& model) {
  const nb::gil_scoped_release release;
  CommandOptions options;
  ParseSettings(settings, &options);
  if (options.source.single_camera) {
    throw InputError("option ImageReader.single_camera: is only for the program, which knows all queries of a run");
  }
  return new PythonLocalizer(options, model);
}

Query MakeMatchesQuery(PythonLocalizer& localizer, const std::string& name, const Camera& camera,
                       const InputPoints& keypoints, const std::vector<PairInput>& pairs) {
  std::vector<GivenPair> given;
  for (const auto& [database_name, database_keypoints, matches] : pairs) {
    GivenPair pair = {database_name, std::nullopt, ToRows<Match>(matches)};
    if (database_keypoints) pair.keypoints = ToRows<Eigen::Vector2d>(*database_keypoints);
    given.push_back(std::move(pair));
  }
  return {localizer.MakeProblem(name, camera, ToRows<Eigen::Vector2d>(keypoints), given)};
}

Query MakePhotoQuery(const std::string& name, const std::string& path, const std::optional<InputPixels>& pixels,
                     const std::optional<Camera>& camera) {
  PhotoQuery photo;
  photo.name = name;
  photo.path = path;
  photo.camera = camera;
  const auto size = [&](size_t axis) { return static_cast<int>(pixels->shape(axis)); };
  if (pixels) photo.file = PhotoFile::FromPixels(pixels->data(), size(1), size(0), size(2));
  return {photo};
}

// Returns the query with a prior of numbers as in the lines of a file.
Query WithPrior(const PythonLocalizer& localizer, Query query, const std::vector<double>& position,
                const std::vector<double>& gravity) {
  query.prior = localizer.MakePrior(position, gravity);
  return query;
}

// Localizes queries, and warns of depth maps that could not be used, once of each.
template <typename... Arguments>
std::vector<OutputAnswer> Localize(PythonLocalizer& localizer, const Arguments&... arguments) {
  std::vector<QueryRecord> records;
  {
    const nb::gil_scoped_release release;
    records = localizer.Localize(arguments...);
  }
  for (const std::string& problem : localizer.TakeDepthProblems()) {
    if (PyErr_WarnEx(PyExc_UserWarning, AsOneLine(problem).c_str(), 1) != 0) throw nb::python_error();
  }
  return ToOutput(records, localizer.Axes());
}

// Localizes a group. name, position, gravity: a query of it and its prior.
std::vector<OutputAnswer> LocalizeStoredGroup(PythonLocalizer& localizer, size_t group, const std::string& name,
                                              const std::vector<double>& position, const std::vector<double>& gravity) {
  return Localize(localizer, group, name, localizer.MakePrior(position, gravity));
}

// Localizes queries as one frame. poses: cam_from_rig of each.
std::vector<OutputAnswer> LocalizeFrame(PythonLocalizer& localizer, const std::vector<Query>& queries,
                                        const InputPoses& poses, const std::string& frame_name, bool has_scale) {
  LAZYLOC_CHECK(queries.size() == poses.shape(0));
  GroupInput input;
  input.has_rig_scale = has_scale;
  input.frames.push_back({frame_name, {}});
  const std::vector<Rigid3d> cams_from_rig = ToPoses(poses);
  for (size_t i = 0; i < queries.size(); ++i) {
    input.frames[0].images.push_back({queries[i].input, cams_from_rig[i], queries[i].prior});
  }
  return Localize(localizer, input);
}

OutputModel ReadModelForPython(const std::string& path) {
  ModelOnDisk read;
  {
    const nb::gil_scoped_release release;
    read = ReadModelWithPoints(path);
  }
  return ToOutput(read);
}

// Runs a command of the program; arguments[0] is its name. Returns its exit code.
int RunAsCommand(int (*run)(int, char**), std::vector<std::string> arguments) {
  const nb::gil_scoped_release release;
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  return run(static_cast<int>(argv.size()), argv.data());
}

}  // namespace

NB_MODULE(_core, module) {
  SilenceLogging();
  nb::set_leak_warnings(false);
  nb::register_exception_translator(TranslateInputError);
  nb::class_<Camera>(module, "Camera").def(nb::new_(&MakeCamera), "model"_a, "width"_a, "height"_a, "params"_a);
  module.def("rays", &ToRays, "camera"_a, "points"_a);
  nb::class_<Model>(module, "Model").def(nb::new_(&MakeModel), "cameras"_a, "names"_a, "poses"_a, "camera_of_image"_a);
  module.def("read_model", &ReadModelForPython, "path"_a);
  nb::class_<Query>(module, "Query");
  module.def(
      "named", [](const std::string& name) { return Query{name}; }, "name"_a);
  module.def("photo", &MakePhotoQuery, "name"_a, "path"_a, "pixels"_a.none(), "camera"_a.none());
  nb::class_<PythonLocalizer>(module, "Localizer")
      .def(nb::new_(&MakeLocalizer), "settings"_a, "model"_a.none())
      .def("warnings", &PythonLocalizer::Warnings)
      .def("groups", &PythonLocalizer::Groups)
      .def("find_group", &PythonLocalizer::FindGroup, "query_name"_a)
      .def("matches", &MakeMatchesQuery, "name"_a, "camera"_a, "keypoints"_a, "pairs"_a)
      .def("with_prior", &WithPrior, "query"_a, "position"_a, "gravity"_a)
      .def("localize_group", &LocalizeStoredGroup, "group"_a, "name"_a, "position"_a, "gravity"_a)
      .def("localize_frame", &LocalizeFrame, "queries"_a, "poses"_a, "frame_name"_a, "has_scale"_a);
  module.def("settings", &ListSettings);
  const auto add_command = [&](const char* name, int (*run)(int, char**)) {
    module.def(
        name, [run](const std::vector<std::string>& arguments) { return RunAsCommand(run, arguments); }, "arguments"_a);
  };
  add_command("run_lazy_localizer", RunLazyLocalizer);
  add_command("run_lazy_indexer", RunLazyIndexer);
  add_command("run_lazy_epoch", RunLazyEpoch);
  add_command("run_lazy_merger", RunLazyMerger);
}

}  // namespace lazyloc
