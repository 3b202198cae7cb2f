// Helpers of benchmarks: wall-clock time, and errors that end the program.
#pragma once

#include <errno.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>

#include "common/base/status.h"

namespace tessera {

// Wall-clock time of `work`.
inline double Seconds(const std::function<void()>& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Prints an error and ends the program with exit code 1.
inline void Check(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s: %s\n", program_invocation_short_name, std::string(status.message()).c_str());
  std::exit(1);
}

template <class T>
T Value(StatusOr<T> value) {
  Check(value.status());
  return *std::move(value);
}

}  // namespace tessera
