// Some of many values.
#ifndef TESSERA_COMMON_BASE_PICK_H_
#define TESSERA_COMMON_BASE_PICK_H_

#include <cstdint>
#include <vector>

namespace tessera {

// Those of `values` at `places`, in the places' order; none if there are no values at all, for what is not known of
// anything is not known of some.
template <class T>
std::vector<T> Pick(const std::vector<T>& values, const std::vector<uint32_t>& places) {
  std::vector<T> picked;
  if (values.empty()) return picked;
  picked.reserve(places.size());
  for (const uint32_t place : places) picked.push_back(values[place]);
  return picked;
}

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_PICK_H_
