// libFuzzer target: deploy/fuzz, or build/fuzz/bin/rpc_fuzzer NEW_INPUTS tests/fuzz/corpus/rpc
#include <cstddef>
#include <cstdint>
#include <string>

#include "tests/fuzz/message_mutator.h"
#include "tests/fuzz/rpc_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  tessera::RunRpcTarget(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  const auto prototype = [](uint8_t kind) -> const google::protobuf::Message* {
    const google::protobuf::MethodDescriptor* const method = tessera::MethodOfKind(kind);
    if (method == nullptr) return nullptr;
    return google::protobuf::MessageFactory::generated_factory()->GetPrototype(method->input_type());
  };
  return tessera::MutateFrames(data, size, max_size, seed, tessera::kCallKinds, prototype);
}
