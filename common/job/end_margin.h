// Time limit of workers.
#pragma once

namespace tessera {

// A worker gets no task that is predicted to end later than this before the end of its allocation. It asks for none
// when less is left.
inline constexpr double kEndMargin_s = 30;

}  // namespace tessera
