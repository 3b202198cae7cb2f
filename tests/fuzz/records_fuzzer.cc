// libFuzzer target: deploy/fuzz, or build/fuzz/bin/records_fuzzer NEW_INPUTS tests/fuzz/corpus/records
#include <cstddef>
#include <cstdint>
#include <string>

#include "tests/fuzz/message_mutator.h"
#include "tests/fuzz/records_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  tessera::RunRecordsTarget(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  return tessera::MutateFrames(data, size, max_size, seed, 4,
                               [](uint8_t) { return &tessera::v1::Record::default_instance(); });
}
