// Secrets of processes: made, compared, kept in files that nobody else reads.
#ifndef TESSERA_COMMON_ACCESS_SECRETS_H_
#define TESSERA_COMMON_ACCESS_SECRETS_H_

#include <string>

#include "common/base/status.h"

namespace tessera {

// All functions are thread-safe. No error names any part of a secret.

// 256 random bits as 43 characters of letters, digits, '-' and '_'.
std::string RandomSecret();

// In a time that does not depend on where they differ.
bool SameSecret(const std::string& a, const std::string& b);

// HMAC-SHA256 of `message`, in hex.
std::string KeyedHash(const std::string& key, const std::string& message);

// The secret that is a file's only line. INVALID_ARGUMENT if it holds anything else; PERMISSION_DENIED if every local
// user may read it.
StatusOr<std::string> ReadSecretFile(const std::string& path);

// Replaces `path` by a file that its owner alone may read; as WriteFileAtomic.
Status WriteSecretFile(const std::string& path, const std::string& content);

// The secret in the file at `path`, which is made with a new one if it is not there.
StatusOr<std::string> EnsureSecretFile(const std::string& path);

// This process leaves no core file, and none is handed to a collector of cores: they would hold its secrets.
void LeaveNoCore();

}  // namespace tessera

#endif  // TESSERA_COMMON_ACCESS_SECRETS_H_
