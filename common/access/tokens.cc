#include "common/access/tokens.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "common/access/secrets.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr char kTimeFormat[] = "%Y-%m-%dT%H:%M:%SZ";
constexpr int64_t kMaxFileBytes = 4 << 20;
constexpr size_t kMaxNameBytes = 64;
constexpr char kNameRule[] = "up to 64 letters, digits, '.', '_' and '-', not starting with '.' or '-'";

constexpr std::pair<Role, const char*> kRoles[] = {
    {Role::kViewer, "viewer"}, {Role::kSubmitter, "submitter"}, {Role::kWorker, "worker"}, {Role::kAdmin, "admin"}};

bool IsName(const std::string& name) {
  return !name.empty() && name.size() <= kMaxNameBytes && name.front() != '.' && name.front() != '-' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' ||
                  c == '-';
         });
}

StatusOr<TokenEntry> ParseLine(const std::vector<std::string>& words, const std::string& path,
                               const std::string& line) {
  // Messages never quote the line: a token may have been put there by mistake.
  const auto fault = [&](const std::string& found, const std::string& expected) {
    return InputError(path, line, found, expected);
  };
  if (words.size() != 4) return fault(absl::StrCat(words.size(), " words"), "4 words: NAME ROLE SHA256 EXPIRY");
  TokenEntry entry;
  entry.name = words[0];
  const auto role = ParseRole(words[1]);
  if (!role) return fault("an unknown role as word 2", "viewer, submitter, worker or admin");
  entry.role = *role;
  entry.sha256 = words[2];
  if (!CheckDigest({entry.sha256, 0}).ok()) return fault("no hash as word 3", "a SHA-256 in lower-case hex");
  if (words[3] != "never") {
    absl::Time time;
    if (!absl::ParseTime(kTimeFormat, words[3], &time, nullptr)) {
      return fault("no time as word 4", "'never' or a UTC time such as 2027-11-23T00:00:00Z");
    }
    entry.expires_us = std::max<int64_t>(1, absl::ToUnixMicros(time));
  }
  return entry;
}

}  // namespace

std::optional<Role> ParseRole(const std::string& name) {
  for (const auto& [role, role_name] : kRoles) {
    if (name == role_name) return role;
  }
  return std::nullopt;
}

std::string NameOf(Role role) {
  for (const auto& [each, name] : kRoles) {
    if (each == role) return name;
  }
  return "";
}

// Bounds the message of a bad file, which is reported each time that the file is read again.
constexpr size_t kMaxFaults = 50;

StatusOr<TokenTable> TokenTable::Parse(const std::string& text, const std::string& path) {
  TokenTable table;
  Faults faults;
  int number = 0;
  for (const auto line : absl::StrSplit(text, '\n')) {
    const std::string where = absl::StrCat("line ", ++number);
    const std::vector<std::string> words = absl::StrSplit(line, absl::ByAnyChar(" \t\r"), absl::SkipEmpty());
    if (words.empty() || words[0][0] == '#') continue;
    const auto entry = ParseLine(words, path, where);
    Status added = entry.status();
    if (added.ok()) added = table.Add(*entry);
    if (entry.ok() && !added.ok()) {
      added = IsName(entry->name) ? InputError(path, where, "a second token named " + entry->name, "a unique name")
                                  : InputError(path, where, "an invalid name as word 1", kNameRule);
    }
    faults.Add(added);
    if (faults.messages().size() == kMaxFaults) {
      faults.Add(InputError(path, where, absl::StrCat(kMaxFaults, " errors so far"), "a file of tokens"));
      break;
    }
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return table;
}

StatusOr<TokenTable> TokenTable::Read(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxFileBytes));
  return Parse(text, path);
}

const TokenEntry* TokenTable::Find(const std::string& token) const {
  const std::string sha256 = Sha256Hex(token);
  const TokenEntry* found = nullptr;
  for (const TokenEntry& entry : entries_) {
    if (SameSecret(entry.sha256, sha256)) found = &entry;
  }
  return found;
}

Status TokenTable::Add(const TokenEntry& entry) {
  if (!IsName(entry.name)) {
    return absl::InvalidArgumentError(absl::StrCat("invalid token name: expected ", kNameRule));
  }
  for (const TokenEntry& other : entries_) {
    if (other.name == entry.name) {
      return absl::InvalidArgumentError("a token named " + entry.name +
                                        " exists: choose another name or revoke it first");
    }
  }
  entries_.push_back(entry);
  return absl::OkStatus();
}

bool TokenTable::Remove(const std::string& name) {
  return std::erase_if(entries_, [&](const TokenEntry& entry) { return entry.name == name; }) > 0;
}

std::string TokenTable::ToText() const {
  std::string text = "# NAME ROLE SHA256-OF-TOKEN EXPIRY; tesserad reloads this file when it changes\n";
  for (const TokenEntry& entry : entries_) {
    const std::string expiry =
        entry.expires_us == 0
            ? "never"
            : absl::FormatTime(kTimeFormat, absl::FromUnixMicros(entry.expires_us), absl::UTCTimeZone());
    absl::StrAppend(&text, entry.name, " ", NameOf(entry.role), " ", entry.sha256, " ", expiry, "\n");
  }
  return text;
}

}  // namespace tessera
