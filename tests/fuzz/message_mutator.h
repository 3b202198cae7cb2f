// Mutates frames as protobuf messages, because random bytes rarely parse.
#pragma once

#include <google/protobuf/message.h>

#include <cstddef>
#include <cstdint>
#include <functional>

namespace tessera {

// LLVMFuzzerCustomMutator for SplitFrames' inputs. `prototype`: of a frame of this kind; null: mere bytes. `kinds`: how
// many kinds there are.
size_t MutateFrames(uint8_t* data, size_t size, size_t max_size, unsigned seed, int kinds,
                    const std::function<const google::protobuf::Message*(uint8_t)>& prototype);

}  // namespace tessera
