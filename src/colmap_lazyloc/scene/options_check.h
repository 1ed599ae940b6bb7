#pragma once

#include <cmath>
#include <sstream>
#include <string>

// Macros for `bool XxxOptions::Check(std::string* error) const`. They return false from it and set `error` to one line
// that names the option and its value, for example "min_num_inliers must be >= 5, but is 3".
#define OPTION_COMPARE(name, op, bound)                                          \
  if (!((name)op(bound)) || !std::isfinite(static_cast<double>(name))) {         \
    std::ostringstream message;                                                  \
    message << #name << " must be " #op " " << (bound) << ", but is " << (name); \
    *error = message.str();                                                      \
    return false;                                                                \
  }
#define OPTION_GT(name, bound) OPTION_COMPARE(name, >, bound)
#define OPTION_GE(name, bound) OPTION_COMPARE(name, >=, bound)
#define OPTION_LE(name, bound) OPTION_COMPARE(name, <=, bound)
