#include "common/access/secrets.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/hmac.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "absl/strings/escaping.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr int64_t kMaxSecretBytes = 4096;

}  // namespace

std::string RandomSecret() {
  unsigned char bytes[32];
  if (::getentropy(bytes, sizeof(bytes)) != 0) std::abort();  // fails only on kernels without random numbers
  std::string text;
  absl::WebSafeBase64Escape({reinterpret_cast<const char*>(bytes), sizeof(bytes)}, &text);
  return text;
}

bool SameSecret(const std::string& a, const std::string& b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::string KeyedHash(const std::string& key, const std::string& message) {
  unsigned char code[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  ::HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), reinterpret_cast<const unsigned char*>(message.data()),
         message.size(), code, &size);
  return std::string(absl::BytesToHexString({reinterpret_cast<const char*>(code), size}));
}

StatusOr<std::string> ReadSecretFile(const std::string& path) {
  struct stat info;
  if (::stat(path.c_str(), &info) == 0 && (info.st_mode & S_IROTH) != 0) {
    return absl::PermissionDeniedError(path + " is readable by every local user: run chmod 600 " + path);
  }
  TESSERA_ASSIGN_OR_RETURN(std::string secret, ReadFile(path, kMaxSecretBytes));
  while (!secret.empty() && (secret.back() == '\n' || secret.back() == '\r')) secret.pop_back();
  const bool printable = std::all_of(secret.begin(), secret.end(), [](char c) { return c > ' ' && c < 127; });
  if (secret.empty() || !printable) {
    return InputError(path, "", secret.empty() ? "an empty file" : "spaces, several lines or unprintable characters",
                      "one line that holds the secret");
  }
  return secret;
}

Status WriteSecretFile(const std::string& path, const std::string& content) {
  return WriteFileAtomic(path, content, S_IRUSR | S_IWUSR);
}

StatusOr<std::string> EnsureSecretFile(const std::string& path) {
  if (!FileExists(path)) TESSERA_RETURN_IF_ERROR(WriteSecretFile(path, RandomSecret() + "\n"));
  return ReadSecretFile(path);
}

void DisableCoreDumps() {
  // A limit of 0 does not stop cores that are piped to a program (core_pattern "|..."); a limit of 1 does.
  const rlimit one_byte = {1, 1};
  ::setrlimit(RLIMIT_CORE, &one_byte);
}

}  // namespace tessera
