// Secrets of processes: creation, comparison, and storage in files that only the owner can read.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

// All functions are thread-safe. No error names any part of a secret.

// 256 random bits as 43 characters of letters, digits, '-' and '_'.
std::string RandomSecret();

// Compares in constant time for equal lengths, so that timing does not reveal where the secrets differ.
bool SameSecret(const std::string& a, const std::string& b);

// HMAC-SHA256 of `message`, in hex.
std::string KeyedHash(const std::string& key, const std::string& message);

// Reads a secret: the only line of the file, at most 4 KiB. INVALID_ARGUMENT if the file holds anything else;
// PERMISSION_DENIED if every local user can read it.
StatusOr<std::string> ReadSecretFile(const std::string& path);

// Replaces `path` atomically by a file that only its owner can read (mode 600), like WriteFileAtomic.
Status WriteSecretFile(const std::string& path, const std::string& content);

// Reads the secret at `path`; first creates the file with a new random secret if it does not exist.
StatusOr<std::string> EnsureSecretFile(const std::string& path);

// Disables core dumps of this process, also those piped to a crash collector, because they would contain its secrets.
void DisableCoreDumps();

}  // namespace tessera
