#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace lazyloc {

// An input or output of a model.
struct OnnxTensor {
  std::vector<int64_t> shape;  // empty: a single value
  std::variant<std::vector<float>, std::vector<int64_t>> values;

  // Returns the values. Throws std::bad_variant_access if they are of the other type.
  const std::vector<float>& Floats() const { return std::get<std::vector<float>>(values); }
  const std::vector<int64_t>& Integers() const { return std::get<std::vector<int64_t>>(values); }
};

// What a model must have: an input or output of this name, type and shape.
struct OnnxNode {
  enum class Type { FLOAT, INTEGER };

  std::string name;
  std::optional<Type> type;    // nullopt for either
  std::vector<int64_t> shape;  // -1 for any size
};

// A network in an ONNX file. ONNX Runtime is loaded with the first model, so that the program does without it
// otherwise; the file is loaded when it is needed, because photos that SIFT localizes need none.
class OnnxModel {
 public:
  // inputs, outputs: in the order of the file. Throws InputError if ONNX Runtime is missing.
  OnnxModel(const std::filesystem::path& path, const std::vector<OnnxNode>& inputs,
            const std::vector<OnnxNode>& outputs);
  ~OnnxModel();

  const std::filesystem::path& Path() const { return path_; }
  // Loads the file unless it is loaded. Throws InputError naming it if it is not such a model. Thread-safe.
  void Load() const;
  // Returns the outputs, of the types and shapes that were asked for. Throws InputError naming the file if it is not
  // such a model, or fails. Thread-safe; uses the calling thread alone, so that the result depends only on the inputs.
  std::vector<OnnxTensor> Run(const std::vector<OnnxTensor>& inputs) const;
  // Throws InputError naming the file.
  [[noreturn]] void Fail(const std::string& problem) const;

 private:
  struct Impl;
  void CreateSession() const;

  const std::filesystem::path path_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
