#include "common/storage/hash.h"

#include <openssl/evp.h>
#include <sys/stat.h>
#include <xxhash.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <new>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"

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

Sha256Hasher::Sha256Hasher() : context_(EVP_MD_CTX_new()) {
  // Fetch once: a fetch takes longer than hashing a task's key.
  static const EVP_MD* const sha256 = EVP_MD_fetch(nullptr, "SHA256", nullptr);
  // Fails only if memory is exhausted or OpenSSL is broken.
  if (context_ == nullptr || EVP_DigestInit_ex(context_.get(), sha256, nullptr) != 1) std::abort();
}

void Sha256Hasher::Free::operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }

void Sha256Hasher::Update(const void* data, size_t size) { EVP_DigestUpdate(context_.get(), data, size); }

std::string Sha256Hasher::Finish() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_DigestFinal_ex(context_.get(), digest, &size);
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
  return absl::StrFormat("%016x%016x", hash.high64, hash.low64);
}

Xxh3Hasher::Xxh3Hasher() : state_(XXH3_createState()) {
  if (state_ == nullptr) throw std::bad_alloc();
  XXH3_64bits_reset(state_.get());
}

void Xxh3Hasher::Free::operator()(XXH3_state_t* state) const { XXH3_freeState(state); }
void Xxh3Hasher::Update(const void* data, size_t size) { XXH3_64bits_update(state_.get(), data, size); }
uint64_t Xxh3Hasher::Digest() const { return XXH3_64bits_digest(state_.get()); }

}  // namespace tessera
