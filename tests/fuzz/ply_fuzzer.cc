// libFuzzer target: cmake --preset fuzz && cmake --build --preset fuzz --target ply_fuzzer
//                   build/fuzz/bin/ply_fuzzer NEW_INPUTS tests/fuzz/corpus/ply
#include <cstddef>
#include <cstdint>
#include <string>

#include "tests/fuzz/ply_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  tessera::RunPlyTarget(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
