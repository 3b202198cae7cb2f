// Access tokens of a coordinator: a name, a role, the SHA-256 of the token and an expiry each. The file holds no token
// itself.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Rights of a token's bearer, one bit each; server/auth/access.cc lists the calls of each role.
enum class Role : unsigned {
  kViewer = 1,     // reads jobs and published results
  kSubmitter = 2,  // a viewer's rights; submits, cancels and changes jobs
  kWorker = 4,     // registers as a worker and leases tasks
  kAdmin = 8,      // a submitter's rights; deletes jobs, reads all results
};

// "viewer", "submitter", "worker", "admin".
std::optional<Role> ParseRole(const std::string& name);
std::string NameOf(Role role);

struct TokenEntry {
  std::string name;  // letters, digits, '.', '_', '-'; identifies the token in logs and when it is revoked
  Role role = Role::kViewer;
  std::string sha256;      // of the token, in hex
  int64_t expires_us = 0;  // Unix time; 0: never
};

// A value type; const methods are thread-safe.
class TokenTable {
 public:
  // Reads one token per line: "NAME ROLE SHA256 EXPIRY", EXPIRY "never" or a UTC time such as 2027-11-23T00:00:00Z.
  // Skips empty lines and lines that begin with #. INVALID_ARGUMENT lists `path` and the line of the first 50 errors.
  static StatusOr<TokenTable> Parse(const std::string& text, const std::string& path);
  static StatusOr<TokenTable> Read(const std::string& path);

  // The entry of `token`, expired entries included; null if there is none. Compares hashes in constant time.
  const TokenEntry* Find(const std::string& token) const;

  // INVALID_ARGUMENT if the name is not valid or already used.
  Status Add(const TokenEntry& entry);
  // False if no entry has this name.
  bool Remove(const std::string& name);
  std::string ToText() const;
  const std::vector<TokenEntry>& entries() const { return entries_; }

 private:
  std::vector<TokenEntry> entries_;
};

}  // namespace tessera
