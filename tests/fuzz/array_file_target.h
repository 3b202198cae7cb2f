// Array files.
#pragma once

#include <cstring>
#include <string>

#include "common/arrays/mapped_arrays.h"
#include "common/storage/hash.h"
#include "tests/fuzz/memory_file.h"

namespace tessera {

// The same with checksums and size that are right wherever they can be found, which no fuzzer would guess.
inline std::string WithChecksums(std::string bytes) {
  const auto number = [&](size_t at) {
    uint64_t value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof(value));
    return value;
  };
  const auto set = [&](size_t at, uint64_t value) { std::memcpy(bytes.data() + at, &value, sizeof(value)); };
  constexpr uint64_t kWidths[] = {4, 8, 4, 4, 8, 1, 2};
  if (bytes.size() < 32) return bytes;
  set(8, bytes.size());
  size_t at = 32;
  for (uint64_t i = 0; i < number(24); ++i) {
    if (bytes.size() - at < 2) return bytes;
    const size_t name = static_cast<uint8_t>(bytes[at]) + 256 * static_cast<uint8_t>(bytes[at + 1]);
    if (bytes.size() - at < name + 27) return bytes;
    at += name + 27;
    const uint8_t type = static_cast<uint8_t>(bytes[at - 25]);
    const uint64_t count = number(at - 24), offset = number(at - 16);
    if (type >= std::size(kWidths) || offset > bytes.size() || count > (bytes.size() - offset) / kWidths[type])
      continue;
    set(at - 8, Xxh3(bytes.data() + offset, count * kWidths[type]));
  }
  const uint64_t metadata = number(16);
  if (bytes.size() - at < 8 || metadata > bytes.size() - at - 8) return bytes;
  set(at + metadata, Xxh3(bytes.data(), at + metadata));
  return bytes;
}

// True if it was taken as an array file.
inline bool RunArrayFileTarget(const std::string& input) {
  bool taken = false;
  for (const std::string& bytes : {input, WithChecksums(input)}) {
    const StatusOr<ArrayFile> file = ParseArrayFile(bytes, "input");
    const MemoryFile memory(bytes);
    const StatusOr<MappedArrays> mapped = MappedArrays::Open(memory.path());
    if (!file.ok()) {
      RequireRefusal(file.status(), absl::StatusCode::kDataLoss);
      continue;
    }
    Require(SerializeArrayFile(*file) == bytes, "nothing is taken but what is written");
    Require(mapped.ok(), "what is read can be mapped");
    for (const auto& [name, data] : file->arrays) Require(mapped->Verify(name).ok(), "both know the checksums");
    taken = true;
  }
  return taken;
}

}  // namespace tessera
