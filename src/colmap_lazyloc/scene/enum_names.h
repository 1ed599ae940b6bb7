#pragma once

#include <array>

namespace lazyloc {

// The names of an enum's values, in their order, as the command line and options.ini have them. An enum that is an
// option specialises it beside its definition.
template <typename Enum>
inline constexpr std::array<const char*, 0> kEnumNames = {};

}  // namespace lazyloc
