#pragma once

#include <string>

#include <nanobind/nanobind.h>

namespace lazyloc {

// Returns a string that Python sees as str. Bytes that are not UTF-8, which names of images may contain, become lone
// surrogates, as in Python's names of files.
inline nanobind::object ToPython(const std::string& bytes) {
  return nanobind::steal(PyUnicode_DecodeUTF8(bytes.data(), static_cast<Py_ssize_t>(bytes.size()), "surrogateescape"));
}

}  // namespace lazyloc

// Takes the place of nanobind's conversion of strings (nanobind/stl/string.h), which refuses such bytes.
template <>
struct nanobind::detail::type_caster<std::string> {
  NB_TYPE_CASTER(std::string, const_name("str"))

  bool from_python(handle source, uint8_t, cleanup_list*) noexcept {
    if (!PyUnicode_Check(source.ptr())) return false;
    PyObject* const encoded = PyUnicode_AsEncodedString(source.ptr(), "utf-8", "surrogateescape");
    if (encoded == nullptr) {
      PyErr_Clear();
      return false;
    }
    value.assign(PyBytes_AsString(encoded), static_cast<size_t>(PyBytes_Size(encoded)));
    Py_DECREF(encoded);
    return true;
  }
  static handle from_cpp(const std::string& text, rv_policy, cleanup_list*) noexcept {
    return lazyloc::ToPython(text).release();
  }
};
