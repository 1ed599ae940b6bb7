#include "colmap_lazyloc/onnx/onnx_model.h"

#include "colmap_lazyloc/scene/errors.h"

#ifdef LAZYLOC_ONNX

#include <algorithm>
#include <cstdlib>
#include <mutex>
#include <optional>

#define ORT_API_MANUAL_INIT  // because the library is loaded at run time
#include <dlfcn.h>
#include <onnxruntime_cxx_api.h>

namespace lazyloc {
namespace {

// Version of ONNX Runtime's interface that has all functions below; later libraries offer it, too.
constexpr uint32_t kApiVersion = 8;
constexpr char kLibraryVariable[] = "LAZYLOC_ONNXRUNTIME";

const OrtApi* LoadApi() {
  const char* const given = std::getenv(kLibraryVariable);
  void* library = nullptr;
  if (given != nullptr && *given != '\0') {
    library = dlopen(given, RTLD_NOW | RTLD_LOCAL);
  } else {
    for (const char* name :
         {"libonnxruntime.so.1", "libonnxruntime.so", "libonnxruntime.so.1.21"}) {  // 1.21: Debian 13
      if (library == nullptr) library = dlopen(name, RTLD_NOW | RTLD_LOCAL);
    }
  }
  if (library == nullptr) {
    const std::string error = dlerror();
    throw InputError("ONNX Runtime is missing (" + error +
                     "): install it, for example by pip install onnxruntime, and "
                     "name its libonnxruntime.so in the environment variable " +
                     kLibraryVariable);
  }
  using GetApiBase = const OrtApiBase* (*)();
  const auto get_base = reinterpret_cast<GetApiBase>(dlsym(library, "OrtGetApiBase"));
  const OrtApi* const api = get_base == nullptr ? nullptr : get_base()->GetApi(kApiVersion);
  if (api == nullptr) {
    throw InputError(std::string(given != nullptr ? given : "libonnxruntime.so") +
                     ": is not a library of ONNX Runtime 1.8 or later");
  }
  return api;
}

// Returns the environment of all models, which lives as long as the program. The first call loads ONNX Runtime.
const Ort::Env& Environment() {
  static const Ort::Env* const environment = [] {
    Ort::InitApi(LoadApi());
    return new Ort::Env(ORT_LOGGING_LEVEL_FATAL, "colmap_lazyloc");
  }();
  return *environment;
}

// Returns nullopt for another type.
std::optional<OnnxNode::Type> TypeOf(ONNXTensorElementDataType type) {
  if (type == ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT) return OnnxNode::Type::FLOAT;
  if (type == ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64) return OnnxNode::Type::INTEGER;
  return std::nullopt;
}

template <typename Info>
bool Fits(const Info& actual, const OnnxNode& wanted) {
  const std::optional<OnnxNode::Type> type = TypeOf(actual.GetElementType());
  const std::vector<int64_t> shape = actual.GetShape();
  return type && type == wanted.type.value_or(*type) &&
         std::equal(shape.begin(), shape.end(), wanted.shape.begin(), wanted.shape.end(),
                    [](int64_t a, int64_t b) { return a == b || a < 0 || b < 0; });
}

std::string Text(const OnnxNode& node) {
  std::string text = node.name + (node.type == OnnxNode::Type::FLOAT ? " (float" : " (int64");
  for (const int64_t size : node.shape) text += " x " + (size < 0 ? std::string("any") : std::to_string(size));
  return text + ")";
}

Ort::Value ToValue(const OnnxTensor& tensor) {
  // Is not copied: the value must not outlive the tensor, whose values ONNX Runtime does not change.
  static const Ort::MemoryInfo* const memory =
      new Ort::MemoryInfo(Ort::MemoryInfo::CreateCpu(OrtDeviceAllocator, OrtMemTypeCPU));
  return std::visit(
      [&](const auto& values) {
        using Number = std::decay_t<decltype(values[0])>;
        return Ort::Value::CreateTensor<Number>(*memory, const_cast<Number*>(values.data()), values.size(),
                                                tensor.shape.data(), tensor.shape.size());
      },
      tensor.values);
}

template <typename Number>
std::vector<Number> Copy(const Ort::Value& value, size_t count) {
  const Number* numbers = value.GetTensorData<Number>();
  return std::vector<Number>(numbers, numbers + count);
}

}  // namespace

struct OnnxModel::Impl {
  std::vector<OnnxNode> inputs, outputs;
  Ort::Session session{nullptr};
  std::once_flag is_loaded;

  // Checks all inputs or all outputs, whose functions these are.
  template <typename GetName, typename GetType>
  void CheckNodes(const std::vector<OnnxNode>& wanted, size_t count, GetName get_name, GetType get_type) const {
    Ort::AllocatorWithDefaultOptions allocator;
    for (size_t i = 0; i < std::max(count, wanted.size()); ++i) {
      if (i >= wanted.size()) throw std::runtime_error("it has more inputs or outputs");
      if (i >= count) throw std::runtime_error("it lacks " + Text(wanted[i]));
      const std::string name = (session.*get_name)(i, allocator).get();
      const Ort::TypeInfo info = (session.*get_type)(i);
      const Ort::ConstTensorTypeAndShapeInfo tensor = info.GetTensorTypeAndShapeInfo();
      if (tensor == nullptr || name != wanted[i].name || !Fits(tensor, wanted[i])) {
        throw std::runtime_error("instead of " + Text(wanted[i]) + " it has " + name);
      }
    }
  }
};

OnnxModel::OnnxModel(const std::filesystem::path& path, const std::vector<OnnxNode>& inputs,
                     const std::vector<OnnxNode>& outputs)
    : path_(path) {
  Environment();  // fails at once without ONNX Runtime
  impl_.reset(new Impl{inputs, outputs, Ort::Session(nullptr), {}});
}

void OnnxModel::CreateSession() const {
  using Session = Ort::Session;
  try {
    Ort::SessionOptions options;
    options.SetIntraOpNumThreads(1).SetInterOpNumThreads(1).SetLogSeverityLevel(ORT_LOGGING_LEVEL_FATAL);
    // Gives memory back after each run, because a large image needs gigabytes.
    options.DisableCpuMemArena().DisableMemPattern();
    impl_->session = Session(Environment(), path_.c_str(), options);
    const Session& session = impl_->session;
    impl_->CheckNodes(impl_->inputs, session.GetInputCount(), &Session::GetInputNameAllocated,
                      &Session::GetInputTypeInfo);
    impl_->CheckNodes(impl_->outputs, session.GetOutputCount(), &Session::GetOutputNameAllocated,
                      &Session::GetOutputTypeInfo);
  } catch (const std::exception& error) {
    Fail(std::string("is not the ONNX model that is needed here: ") + error.what());
  }
}

OnnxModel::~OnnxModel() = default;

void OnnxModel::Load() const {
  std::call_once(impl_->is_loaded, [this] { CreateSession(); });
}

std::vector<OnnxTensor> OnnxModel::Run(const std::vector<OnnxTensor>& inputs) const {
  LAZYLOC_CHECK(inputs.size() == impl_->inputs.size());
  Load();
  std::vector<const char*> input_names, output_names;
  for (const OnnxNode& node : impl_->inputs) input_names.push_back(node.name.c_str());
  for (const OnnxNode& node : impl_->outputs) output_names.push_back(node.name.c_str());
  std::vector<OnnxTensor> outputs;
  try {
    std::vector<Ort::Value> values;
    for (const OnnxTensor& tensor : inputs) values.push_back(ToValue(tensor));
    const std::vector<Ort::Value> made = impl_->session.Run(Ort::RunOptions(nullptr), input_names.data(), values.data(),
                                                            values.size(), output_names.data(), output_names.size());
    for (size_t i = 0; i < made.size(); ++i) {
      const Ort::TensorTypeAndShapeInfo info = made[i].GetTensorTypeAndShapeInfo();
      if (!Fits(info, impl_->outputs[i])) throw std::runtime_error("its output is not " + Text(impl_->outputs[i]));
      OnnxTensor& output = outputs.emplace_back(OnnxTensor{info.GetShape(), {}});
      if (info.GetElementType() == ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT) {
        output.values = Copy<float>(made[i], info.GetElementCount());
      } else {
        output.values = Copy<int64_t>(made[i], info.GetElementCount());
      }
    }
  } catch (const std::exception& error) {
    Fail(std::string("the model cannot be run: ") + error.what());
  }
  return outputs;
}

#else  // LAZYLOC_ONNX

namespace lazyloc {

struct OnnxModel::Impl {};

OnnxModel::OnnxModel(const std::filesystem::path& path, const std::vector<OnnxNode>&, const std::vector<OnnxNode>&)
    : path_(path) {
  Fail("models cannot be run, because this program was built without the headers of ONNX Runtime");
}

OnnxModel::~OnnxModel() = default;

void OnnxModel::Load() const {}

std::vector<OnnxTensor> OnnxModel::Run(const std::vector<OnnxTensor>&) const { return {}; }

#endif  // LAZYLOC_ONNX

void OnnxModel::Fail(const std::string& problem) const { throw InputError(path_.string() + ": " + problem); }

}  // namespace lazyloc
