// The version of the algorithms: whatever changes a task's output bytes raises it, and results made before are made
// anew.
#ifndef TESSERA_COMMON_BASE_VERSION_H_
#define TESSERA_COMMON_BASE_VERSION_H_

namespace tessera {

// Part of every task's key; coordinator and workers must agree on it.
inline constexpr char kAlgorithmVersion[] = "19";

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_VERSION_H_
