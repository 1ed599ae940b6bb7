#pragma once

#include <array>
#include <cstddef>

namespace lazyloc {

// The names of an enum's values, in their order, as the command line and options.ini have them. An enum that is an
// option specialises it beside its definition.
template <typename Enum>
inline constexpr std::array<const char*, 0> kEnumNames = {};

template <typename Enum>
const char* EnumName(Enum value) {
  return kEnumNames<Enum>[static_cast<size_t>(value)];
}

}  // namespace lazyloc
