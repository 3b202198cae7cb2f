#include "common/storage/hash.h"

#include <openssl/evp.h>
#include <sys/stat.h>
#include <xxhash.h>

#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <new>
#include <vector>

#include "absl/strings/escaping.h"

namespace tessera {
namespace {

// Values of lower-case hex digits; 16 for other characters. A table, because a coordinator's start reads 10^8 digits.
constexpr std::array<uint8_t, 256> kHexValues = [] {
  std::array<uint8_t, 256> values = {};
  values.fill(16);
  for (int digit = 0; digit < 16; ++digit) values["0123456789abcdef"[digit]] = static_cast<uint8_t>(digit);
  return values;
}();

uint8_t HexValue(char digit) { return kHexValues[static_cast<unsigned char>(digit)]; }

bool IsSha256Hex(const std::string& text) {
  if (text.size() != 64) return false;
  unsigned all = 0;
  for (const char c : text) all |= HexValue(c);
  return all < 16;
}

}  // namespace

struct Sha256Hasher::Impl {
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  Impl() {
    // Fetch once: a fetch takes longer than hashing a task's key.
    static const EVP_MD* const sha256 = EVP_MD_fetch(nullptr, "SHA256", nullptr);
    // Fails only if memory is exhausted or OpenSSL is broken.
    if (context == nullptr || EVP_DigestInit_ex(context, sha256, nullptr) != 1) std::abort();
  }
  ~Impl() { EVP_MD_CTX_free(context); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
};

Sha256Hasher::Sha256Hasher() : impl_(std::make_unique<Impl>()) {}
Sha256Hasher::~Sha256Hasher() = default;
Sha256Hasher::Sha256Hasher(Sha256Hasher&&) noexcept = default;
Sha256Hasher& Sha256Hasher::operator=(Sha256Hasher&&) noexcept = default;

void Sha256Hasher::Update(const void* data, size_t size) { EVP_DigestUpdate(impl_->context, data, size); }

std::string Sha256Hasher::Finish() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_DigestFinal_ex(impl_->context, digest, &size);
  return absl::BytesToHexString({reinterpret_cast<const char*>(digest), size});
}

std::string Sha256Hex(const std::string& bytes) {
  Sha256Hasher hasher;
  hasher.Update(bytes);
  return hasher.Finish();
}

StatusOr<Digest> HashFile(const std::string& path) {
  struct stat info;  // opening a pipe would block
  if (::stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) return absl::NotFoundError("no file: " + path);
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError("cannot open " + path);
  Sha256Hasher hasher;
  Digest digest;
  std::vector<char> buffer(1 << 18);
  while (file) {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    hasher.Update(buffer.data(), static_cast<size_t>(file.gcount()));
    digest.size_bytes += file.gcount();
  }
  if (file.bad() || !file.eof()) return absl::InternalError("cannot read " + path);
  digest.sha256 = hasher.Finish();
  return digest;
}

std::optional<Sha256> Sha256::FromHex(const std::string& hex) {
  if (!IsSha256Hex(hex)) return std::nullopt;
  Sha256 sha256;
  for (size_t i = 0; i < sha256.bytes_.size(); ++i) {
    sha256.bytes_[i] = static_cast<char>(HexValue(hex[2 * i]) << 4 | HexValue(hex[2 * i + 1]));
  }
  return sha256;
}

std::string Sha256::Hex() const { return absl::BytesToHexString({bytes_.data(), bytes_.size()}); }

Status CheckDigest(const Digest& digest) {
  if (IsSha256Hex(digest.sha256) && digest.size_bytes >= 0) return absl::OkStatus();
  return absl::InvalidArgumentError("malformed digest: sha256 '" + digest.sha256.substr(0, 80) + "', " +
                                    std::to_string(digest.size_bytes) + " bytes");
}

uint64_t Xxh3(const void* data, size_t size) { return XXH3_64bits(data, size); }

std::string Xxh3Hex(const void* data, size_t size) {
  const XXH128_hash_t hash = XXH3_128bits(data, size);
  char text[33];
  std::snprintf(text, sizeof(text), "%016" PRIx64 "%016" PRIx64, static_cast<uint64_t>(hash.high64),
                static_cast<uint64_t>(hash.low64));
  return text;
}

struct Xxh3Hasher::Impl {
  XXH3_state_t* state = XXH3_createState();
  Impl() {
    if (state == nullptr) throw std::bad_alloc();
    XXH3_64bits_reset(state);
  }
  ~Impl() { XXH3_freeState(state); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
};

Xxh3Hasher::Xxh3Hasher() : impl_(std::make_unique<Impl>()) {}
Xxh3Hasher::~Xxh3Hasher() = default;
Xxh3Hasher::Xxh3Hasher(Xxh3Hasher&&) noexcept = default;
Xxh3Hasher& Xxh3Hasher::operator=(Xxh3Hasher&&) noexcept = default;
void Xxh3Hasher::Update(const void* data, size_t size) { XXH3_64bits_update(impl_->state, data, size); }
uint64_t Xxh3Hasher::Digest() const { return XXH3_64bits_digest(impl_->state); }

}  // namespace tessera
