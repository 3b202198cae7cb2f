// Content hashes. SHA-256 names blobs. XXH3 is the checksum of chunks, array files and records (64 bits) and identifies
// decoded pixels (128 bits).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/status.h"

struct evp_md_ctx_st;  // of OpenSSL
struct XXH3_state_s;

namespace tessera {

// Name of a blob.
struct Digest {
  std::string sha256;  // 64 lower-case hex digits
  int64_t size_bytes = 0;
  friend bool operator==(const Digest&, const Digest&) = default;
};

// A file by name and content.
struct NamedDigest {
  std::string name;
  Digest digest;
  friend bool operator==(const NamedDigest&, const NamedDigest&) = default;
};

// A SHA-256 in 32 bytes, for collections of millions.
class Sha256 {
 public:
  Sha256() = default;  // zeros
  // Nullopt unless `hex` consists of 64 lower-case hex digits.
  static std::optional<Sha256> FromHex(const std::string& hex);
  std::string Hex() const;
  friend bool operator==(const Sha256&, const Sha256&) = default;
  template <class H>
  friend H AbslHashValue(H state, const Sha256& sha256) {
    return H::combine(std::move(state), sha256.bytes_);
  }

 private:
  std::array<char, 32> bytes_ = {};
};

// Incremental SHA-256. Not thread-safe.
class Sha256Hasher {
 public:
  Sha256Hasher();
  void Update(const void* data, size_t size);
  void Update(const std::string& bytes) { Update(bytes.data(), bytes.size()); }
  // SHA-256 of all bytes, in hex. No call may follow.
  std::string Finish();

 private:
  struct Free {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, Free> context_;
};

// SHA-256 in lower-case hex.
std::string Sha256Hex(const std::string& bytes);

// Digest of a regular file. NOT_FOUND if it does not exist or cannot be opened.
StatusOr<Digest> HashFile(const std::string& path);

// INVALID_ARGUMENT unless the digest has 64 lower-case hex digits and a size of at least 0. Check digests before their
// use in a path.
Status CheckDigest(const Digest& digest);

// XXH3-64.
uint64_t Xxh3(const void* data, size_t size);
inline uint64_t Xxh3(const std::string& bytes) { return Xxh3(bytes.data(), bytes.size()); }

// XXH3-128 as 32 lower-case hex digits. Not secure against forged content.
std::string Xxh3Hex(const void* data, size_t size);

// Incremental XXH3-64. Not thread-safe.
class Xxh3Hasher {
 public:
  Xxh3Hasher();
  void Update(const void* data, size_t size);
  uint64_t Digest() const;  // of all bytes so far

 private:
  struct Free {
    void operator()(XXH3_state_s* state) const;
  };
  std::unique_ptr<XXH3_state_s, Free> state_;
};

}  // namespace tessera
