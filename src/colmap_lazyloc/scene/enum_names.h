#pragma once

#include <array>
#include <cstddef>

namespace lazyloc {

// Names of an enum's values, in the order of the values, for the command line and options.ini. Each enum that is an
// option specialises this array beside its definition.
template <typename Enum>
inline constexpr std::array<const char*, 0> kEnumNames = {};

template <typename Enum>
const char* EnumName(Enum value) {
  return kEnumNames<Enum>[static_cast<size_t>(value)];
}

}  // namespace lazyloc
