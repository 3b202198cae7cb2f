// Strong integer ids: ids of different things, and ids and integers, do not convert to each other.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>

namespace tessera {

template <class Tag, class Value = int32_t>
class Id {
 public:
  constexpr Id() = default;
  constexpr explicit Id(Value value) : value_(value) {}
  constexpr Value value() const { return value_; }
  friend constexpr auto operator<=>(Id, Id) = default;

 private:
  Value value_ = -1;
};

}  // namespace tessera

template <class Tag, class Value>
struct std::hash<tessera::Id<Tag, Value>> {
  size_t operator()(tessera::Id<Tag, Value> id) const { return std::hash<Value>()(id.value()); }
};
