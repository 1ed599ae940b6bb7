#pragma once

#include <vector>

namespace lazyloc {

// Returns pointers to the values, which must outlive them.
template <typename Value>
std::vector<const Value*> Refs(const std::vector<Value>& values) {
  std::vector<const Value*> refs;
  refs.reserve(values.size());
  for (const Value& value : values) refs.push_back(&value);
  return refs;
}

}  // namespace lazyloc
