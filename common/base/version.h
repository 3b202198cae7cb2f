// The version of the algorithms. Raise it with every change of a task's output bytes; earlier results are then computed
// again. Raise it also with the constants of the cost model: both parts of a job are laid out in tiles by them.
#pragma once

namespace tessera {

// It is part of every task's key. Coordinator and workers must have the same version.
inline constexpr char kAlgorithmVersion[] = "31";

}  // namespace tessera
