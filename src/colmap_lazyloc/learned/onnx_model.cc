#include "colmap_lazyloc/learned/onnx_model.h"

#include "colmap_lazyloc/scene/errors.h"

#ifdef LAZYLOC_ONNX

#include <algorithm>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <utility>

#include <dlfcn.h>
#include <onnxruntime_c_api.h>

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

const OrtApi& Api() {
  static const OrtApi* const api = LoadApi();
  return *api;
}

void Check(OrtStatus* status) {
  if (status == nullptr) return;
  const std::string message = Api().GetErrorMessage(status);
  Api().ReleaseStatus(status);
  throw std::runtime_error(message);
}

template <typename T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

// Calls `create` with its arguments and the place for a new object.
template <typename T, typename Create, typename... Arguments>
Owned<T> Make(void (*release)(T*), Create create, const Arguments&... arguments) {
  T* made = nullptr;
  Check(create(arguments..., &made));
  return {made, release};
}

// Returns the environment of all models, which lives as long as the program.
const OrtEnv* Environment() {
  static const OrtEnv* const environment =
      Make<OrtEnv>(Api().ReleaseEnv, Api().CreateEnv, ORT_LOGGING_LEVEL_FATAL, "colmap_lazyloc").release();
  return environment;
}

struct TensorType {
  std::optional<OnnxNode::Type> type;  // nullopt if it is another one
  std::vector<int64_t> shape;
};

TensorType TypeOf(const OrtTensorTypeAndShapeInfo* info) {
  TensorType result;
  ONNXTensorElementDataType type = ONNX_TENSOR_ELEMENT_DATA_TYPE_UNDEFINED;
  size_t num_dims = 0;
  Check(Api().GetTensorElementType(info, &type));
  Check(Api().GetDimensionsCount(info, &num_dims));
  if (type == ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT) result.type = OnnxNode::Type::FLOAT;
  if (type == ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64) result.type = OnnxNode::Type::INTEGER;
  result.shape.resize(num_dims);
  Check(Api().GetDimensions(info, result.shape.data(), num_dims));
  return result;
}

bool Fits(const TensorType& actual, const OnnxNode& wanted) {
  return actual.type && actual.type == wanted.type.value_or(*actual.type) &&
         std::equal(actual.shape.begin(), actual.shape.end(), wanted.shape.begin(), wanted.shape.end(),
                    [](int64_t a, int64_t b) { return a == b || a < 0 || b < 0; });
}

std::string Text(const OnnxNode& node) {
  std::string text = node.name + (node.type == OnnxNode::Type::FLOAT ? " (float" : " (int64");
  for (const int64_t size : node.shape) text += " x " + (size < 0 ? std::string("any") : std::to_string(size));
  return text + ")";
}

Owned<OrtValue> ToValue(const OnnxTensor& tensor) {
  // Is not copied: the value must not outlive the tensor, whose values ONNX Runtime does not change.
  const auto memory =
      Make<OrtMemoryInfo>(Api().ReleaseMemoryInfo, Api().CreateCpuMemoryInfo, OrtDeviceAllocator, OrtMemTypeCPU);
  return std::visit(
      [&](const auto& values) {
        using Number = std::decay_t<decltype(values[0])>;
        constexpr auto kType =
            std::is_same_v<Number, float> ? ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT : ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64;
        return Make<OrtValue>(Api().ReleaseValue, Api().CreateTensorWithDataAsOrtValue, memory.get(),
                              const_cast<Number*>(values.data()), values.size() * sizeof(Number), tensor.shape.data(),
                              tensor.shape.size(), kType);
      },
      tensor.values);
}

template <typename Number>
std::vector<Number> Copy(OrtValue* value, size_t count) {
  void* data = nullptr;
  Check(Api().GetTensorMutableData(value, &data));
  const auto* numbers = static_cast<const Number*>(data);
  return std::vector<Number>(numbers, numbers + count);
}

}  // namespace

struct OnnxModel::Impl {
  std::vector<OnnxNode> inputs, outputs;
  Owned<OrtSession> session{nullptr, nullptr};
  std::once_flag is_loaded;

  // Checks all inputs or all outputs, whose functions these are.
  template <typename GetCount, typename GetName, typename GetType>
  void CheckNodes(const std::vector<OnnxNode>& wanted, GetCount get_count, GetName get_name, GetType get_type) const {
    size_t count = 0;
    Check(get_count(session.get(), &count));
    OrtAllocator* allocator = nullptr;
    Check(Api().GetAllocatorWithDefaultOptions(&allocator));
    for (size_t i = 0; i < std::max(count, wanted.size()); ++i) {
      if (i >= wanted.size()) throw std::runtime_error("it has more inputs or outputs");
      if (i >= count) throw std::runtime_error("it lacks " + Text(wanted[i]));
      char* text = nullptr;
      Check(get_name(session.get(), i, allocator, &text));
      const std::string name = text;
      Check(Api().AllocatorFree(allocator, text));
      const auto info = Make<OrtTypeInfo>(Api().ReleaseTypeInfo, get_type, session.get(), i);
      const OrtTensorTypeAndShapeInfo* tensor = nullptr;
      Check(Api().CastTypeInfoToTensorInfo(info.get(), &tensor));
      if (tensor == nullptr || name != wanted[i].name || !Fits(TypeOf(tensor), wanted[i])) {
        throw std::runtime_error("instead of " + Text(wanted[i]) + " it has " + name);
      }
    }
  }
};

OnnxModel::OnnxModel(const std::filesystem::path& path, const std::vector<OnnxNode>& inputs,
                     const std::vector<OnnxNode>& outputs)
    : path_(path), impl_(new Impl{inputs, outputs, {nullptr, nullptr}, {}}) {
  Api();  // fails at once without ONNX Runtime
}

void OnnxModel::CreateSession() const {
  const OrtApi& api = Api();
  try {
    const auto options = Make<OrtSessionOptions>(api.ReleaseSessionOptions, api.CreateSessionOptions);
    Check(api.SetIntraOpNumThreads(options.get(), 1));
    Check(api.SetInterOpNumThreads(options.get(), 1));
    Check(api.SetSessionLogSeverityLevel(options.get(), ORT_LOGGING_LEVEL_FATAL));
    // Gives memory back after each run, because a large image needs gigabytes.
    Check(api.DisableCpuMemArena(options.get()));
    Check(api.DisableMemPattern(options.get()));
    impl_->session =
        Make<OrtSession>(api.ReleaseSession, api.CreateSession, Environment(), path_.c_str(), options.get());
    impl_->CheckNodes(impl_->inputs, api.SessionGetInputCount, api.SessionGetInputName, api.SessionGetInputTypeInfo);
    impl_->CheckNodes(impl_->outputs, api.SessionGetOutputCount, api.SessionGetOutputName,
                      api.SessionGetOutputTypeInfo);
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
  const OrtApi& api = Api();
  std::vector<const char*> input_names, output_names;
  for (const OnnxNode& node : impl_->inputs) input_names.push_back(node.name.c_str());
  for (const OnnxNode& node : impl_->outputs) output_names.push_back(node.name.c_str());
  std::vector<OnnxTensor> outputs;
  try {
    std::vector<Owned<OrtValue>> input_values, output_values;
    std::vector<const OrtValue*> input_pointers;
    for (const OnnxTensor& tensor : inputs) {
      input_values.push_back(ToValue(tensor));
      input_pointers.push_back(input_values.back().get());
    }
    std::vector<OrtValue*> made(output_names.size());
    OrtStatus* const status =
        api.Run(impl_->session.get(), /*run_options=*/nullptr, input_names.data(), input_pointers.data(),
                input_pointers.size(), output_names.data(), output_names.size(), made.data());
    for (OrtValue* value : made) output_values.emplace_back(value, api.ReleaseValue);
    Check(status);
    for (size_t i = 0; i < made.size(); ++i) {
      const auto info =
          Make<OrtTensorTypeAndShapeInfo>(api.ReleaseTensorTypeAndShapeInfo, api.GetTensorTypeAndShape, made[i]);
      const TensorType type = TypeOf(info.get());
      if (!Fits(type, impl_->outputs[i])) throw std::runtime_error("its output is not " + Text(impl_->outputs[i]));
      size_t count = 0;
      Check(api.GetTensorShapeElementCount(info.get(), &count));
      OnnxTensor& output = outputs.emplace_back(OnnxTensor{type.shape, {}});
      if (*type.type == OnnxNode::Type::FLOAT) {
        output.values = Copy<float>(made[i], count);
      } else {
        output.values = Copy<int64_t>(made[i], count);
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
