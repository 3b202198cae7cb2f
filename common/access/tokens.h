// Who may call a coordinator: names with roles, known by the hashes of their tokens.
#ifndef TESSERA_COMMON_ACCESS_TOKENS_H_
#define TESSERA_COMMON_ACCESS_TOKENS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// What its bearer may do; server/auth/access.cc says which calls. Each is a bit.
enum class Role : unsigned {
  kViewer = 1,     // reads jobs and what they published
  kSubmitter = 2,  // what a viewer may; submits and steers jobs
  kWorker = 4,     // works
  kAdmin = 8,      // what a submitter may; deletes jobs, reads all results
};

// "viewer", "submitter", "worker", "admin".
std::optional<Role> ParseRole(const std::string& name);
std::string NameOf(Role role);

struct TokenEntry {
  std::string name;  // letters, digits, '.', '_', '-'; for logs and for revoking it
  Role role = Role::kViewer;
  std::string sha256;      // of the token, in hex
  int64_t expires_us = 0;  // Unix time; 0: never
};

// A plain value: thread-safe once made.
class TokenTable {
 public:
  // A token a line: "NAME ROLE SHA256 EXPIRY", EXPIRY "never" or as 2027-11-23T00:00:00Z; empty lines and those that
  // begin with # are left out. INVALID_ARGUMENT names `path` and the line of every fault.
  static StatusOr<TokenTable> Parse(const std::string& text, const std::string& path);
  static StatusOr<TokenTable> Read(const std::string& path);

  // Null if nobody has this token. Takes the same time wherever its hash differs from others. Expired ones too.
  const TokenEntry* Find(const std::string& token) const;

  // INVALID_ARGUMENT if the name is none, or taken.
  Status Add(const TokenEntry& entry);
  // False if there is none of the name.
  bool Remove(const std::string& name);
  std::string ToText() const;
  const std::vector<TokenEntry>& entries() const { return entries_; }

 private:
  std::vector<TokenEntry> entries_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_ACCESS_TOKENS_H_
