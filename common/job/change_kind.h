// Kinds of changes between flights.
#pragma once

#include <array>

namespace tessera {

enum class ChangeKind {
  kBuilt,       // higher, and no vegetation now
  kDemolished,  // lower, and no vegetation before
  kGrown,       // higher, vegetation now
  kFelled,      // lower, vegetation before
  kLabel,       // of equal height, another class
};
inline constexpr std::array kChangeKinds = {ChangeKind::kBuilt, ChangeKind::kDemolished, ChangeKind::kGrown,
                                            ChangeKind::kFelled, ChangeKind::kLabel};

// "built", "demolished", "grown", "felled", "label".
constexpr const char* ChangeKindName(ChangeKind kind) {
  constexpr std::array kNames = {"built", "demolished", "grown", "felled", "label"};
  return kNames[static_cast<size_t>(kind)];
}

}  // namespace tessera
