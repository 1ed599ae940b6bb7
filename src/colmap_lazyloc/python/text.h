#pragma once

#include <string>

#include <nanobind/nanobind.h>

namespace lazyloc {

// A string that Python sees as str. Bytes that are not UTF-8, which names of images may contain, become lone
// surrogates, as in Python's names of files.
struct Text {
  std::string bytes;
};

inline nanobind::object ToPython(const std::string& bytes) {
  return nanobind::steal(PyUnicode_DecodeUTF8(bytes.data(), static_cast<Py_ssize_t>(bytes.size()), "surrogateescape"));
}

}  // namespace lazyloc

template <>
struct nanobind::detail::type_caster<lazyloc::Text> {
  NB_TYPE_CASTER(lazyloc::Text, const_name("str"))

  bool from_python(handle source, uint8_t, cleanup_list*) noexcept {
    if (!PyUnicode_Check(source.ptr())) return false;
    PyObject* const encoded = PyUnicode_AsEncodedString(source.ptr(), "utf-8", "surrogateescape");
    if (encoded == nullptr) {
      PyErr_Clear();
      return false;
    }
    value.bytes.assign(PyBytes_AsString(encoded), static_cast<size_t>(PyBytes_Size(encoded)));
    Py_DECREF(encoded);
    return true;
  }
  static handle from_cpp(const lazyloc::Text& text, rv_policy, cleanup_list*) noexcept {
    return lazyloc::ToPython(text.bytes).release();
  }
};
