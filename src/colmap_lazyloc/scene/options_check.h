#pragma once

#include <cmath>
#include <sstream>
#include <string>

// For `bool XxxOptions::Check(std::string* error) const`: returns false with a line that names the option.
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
