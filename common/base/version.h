// The version of the algorithms. Raise it with every change of a task's output bytes; earlier results are then computed
// again.
#ifndef TESSERA_COMMON_BASE_VERSION_H_
#define TESSERA_COMMON_BASE_VERSION_H_

namespace tessera {

// It is part of every task's key. Coordinator and workers must have the same version.
inline constexpr char kAlgorithmVersion[] = "19";

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_VERSION_H_
