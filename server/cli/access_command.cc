// `tessera access`: creates certificates and tokens for a coordinator and its clients.
#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/access/certificates.h"
#include "common/access/secrets.h"
#include "common/access/tokens.h"
#include "common/base/clock.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"

namespace tessera {
namespace {

constexpr int64_t kDay_s = 86400;
constexpr int64_t kClockSkew_s = 3600;  // certificates are valid from this long ago, for machines with slow clocks
constexpr int64_t kMaxPemBytes = 1 << 20;

struct AccessFlags {
  std::string folder;
  std::vector<std::string> hosts, tokens, names;
  int days = 0;
};

int64_t Now_s() { return SystemClock().UnixTimeUs() / 1'000'000; }

CertificateTerms Terms(const std::string& name, const std::vector<std::string>& hosts, int days) {
  return {name, hosts, Now_s(), -kClockSkew_s, days * kDay_s};
}

// Never replaces a file: clients may already use it.
Status WriteNew(const std::string& path, const std::string& content) {
  if (FileExists(path)) return absl::AlreadyExistsError(path + " already exists; delete it first to create a new one");
  TESSERA_RETURN_IF_ERROR(WriteSecretFile(path, content));
  std::printf("%s\n", path.c_str());
  return absl::OkStatus();
}

Status WriteCertificate(const std::string& stem, const Certificate& made) {
  TESSERA_RETURN_IF_ERROR(WriteNew(stem + ".key", made.key_pem));
  return WriteNew(stem + ".pem", made.certificate_pem);
}

StatusOr<Certificate> ReadAuthority(const std::string& folder) {
  Certificate authority;
  TESSERA_ASSIGN_OR_RETURN(authority.certificate_pem, ReadFile(folder + "/ca.pem", kMaxPemBytes));
  TESSERA_ASSIGN_OR_RETURN(authority.key_pem, ReadFile(folder + "/ca.key", kMaxPemBytes));
  return authority;
}

Status MakeServer(const AccessFlags& flags) {
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(flags.folder));
  if (!FileExists(flags.folder + "/ca.key")) {
    TESSERA_ASSIGN_OR_RETURN(const Certificate made, MakeAuthority(Terms("Tessera authority", {}, flags.days)));
    TESSERA_RETURN_IF_ERROR(WriteCertificate(flags.folder + "/ca", made));
  }
  TESSERA_ASSIGN_OR_RETURN(const Certificate authority, ReadAuthority(flags.folder));
  TESSERA_ASSIGN_OR_RETURN(const Certificate server,
                           MakeCertificate(authority, Terms("Tessera coordinator", flags.hosts, flags.days)));
  return WriteCertificate(flags.folder + "/server", server);
}

StatusOr<TokenTable> ReadTokens(const std::string& path) {
  return FileExists(path) ? TokenTable::Read(path) : StatusOr<TokenTable>(TokenTable());
}

Status MakeTokens(const AccessFlags& flags) {
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(flags.folder));
  TESSERA_ASSIGN_OR_RETURN(const FileLock lock, FileLock::Acquire(flags.folder + "/lock"));
  const std::string path = flags.folder + "/tokens";
  TESSERA_ASSIGN_OR_RETURN(TokenTable table, ReadTokens(path));
  std::vector<std::pair<std::string, std::string>> made;
  for (const std::string& asked : flags.tokens) {
    const std::vector<std::string> parts = absl::StrSplit(asked, ':');
    const auto role = parts.size() == 2 ? ParseRole(parts[1]) : std::nullopt;
    if (!role) {
      return InputError("token", "", "'" + asked + "'", "NAME:ROLE, where ROLE is viewer, submitter, worker or admin");
    }
    const std::string token = RandomSecret();
    const int64_t expires_us = flags.days > 0 ? (Now_s() + flags.days * kDay_s) * 1'000'000 : 0;
    TESSERA_RETURN_IF_ERROR(table.Add({parts[0], *role, Sha256Hex(token), expires_us}));
    made.emplace_back(flags.folder + "/" + parts[0] + ".token", token);
  }
  for (const auto& [file, token] : made) TESSERA_RETURN_IF_ERROR(WriteNew(file, token + "\n"));
  return WriteSecretFile(path, table.ToText());
}

Status RevokeTokens(const AccessFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const FileLock lock, FileLock::Acquire(flags.folder + "/lock"));
  const std::string path = flags.folder + "/tokens";
  TESSERA_ASSIGN_OR_RETURN(TokenTable table, TokenTable::Read(path));
  for (const std::string& name : flags.names) {
    if (!table.Remove(name)) return InputError(path, "", "no token named '" + name + "'", "a name in this file");
  }
  TESSERA_RETURN_IF_ERROR(WriteSecretFile(path, table.ToText()));
  for (const std::string& name : flags.names) {
    TESSERA_RETURN_IF_ERROR(RemoveTree(flags.folder + "/" + name + ".token"));
  }
  return absl::OkStatus();
}

Status MakeCallers(const AccessFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const Certificate authority, ReadAuthority(flags.folder));
  for (const std::string& name : flags.names) {
    TESSERA_ASSIGN_OR_RETURN(const std::string stem, JoinInside(flags.folder, name));
    TESSERA_ASSIGN_OR_RETURN(const Certificate made, MakeCertificate(authority, Terms(name, {}, flags.days)));
    TESSERA_RETURN_IF_ERROR(WriteCertificate(stem, made));
  }
  return absl::OkStatus();
}

CLI::App* AddAction(CLI::App& command, const std::string& name, const std::string& what, const std::string& example,
                    const std::shared_ptr<AccessFlags>& flags, int* exit_code, Status (*act)(const AccessFlags&)) {
  CLI::App* action = command.add_subcommand(name, what);
  action->footer("Example:\n  tessera access " + name + " " + example);
  action->add_option("FOLDER", flags->folder, "Folder of the files; only the user may read it")->required();
  action->callback([flags, exit_code, act] {
    ::umask(S_IRWXG | S_IRWXO);
    const Status status = act(*flags);
    *exit_code = status.ok() ? kExitOk : ReportError("access", status);
  });
  return action;
}

void AddDays(CLI::App& action, const std::shared_ptr<AccessFlags>& flags, int by_default, const std::string& what) {
  action.add_option("--days", flags->days, absl::StrCat(what, " (default ", by_default, ")"))
      ->check(CLI::Range(0, 36500));
  action.preparse_callback([flags, by_default](size_t) { flags->days = by_default; });
}

}  // namespace

void AddAccessCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<AccessFlags>();
  CLI::App* command = app.add_subcommand("access", "Create certificates and tokens for a coordinator");
  command->require_subcommand(1);
  command->footer(
      "Prints the files that it creates; only the user can read them. NAME.token holds the token itself: give it to "
      "the\n"
      "client NAME. The coordinator reads the file `tokens`, which holds only the hashes.\n"
      "Examples:\n"
      "  tessera access server keys city-server 10.0.0.5\n"
      "  tessera access token keys anna:submitter vera:viewer rack:worker\n"
      "  tesserad --listen 0.0.0.0:7575 --tls-cert keys/server.pem --tls-key keys/server.key --token-file keys/tokens "
      "\\\n"
      "           --scene-root /srv/cities\n"
      "  tessera jobs --coordinator city-server:7575 --tls-ca keys/ca.pem --token-file keys/anna.token\n"
      "  tessera access revoke keys vera");
  CLI::App* server = AddAction(*command, "server", "Create a certificate authority and the coordinator's certificate",
                               "keys city-server 10.0.0.5", flags, exit_code, MakeServer);
  server
      ->add_option("HOST", flags->hosts,
                   "Host names and IP addresses of the coordinator, and of all that take over from it")
      ->required();
  AddDays(*server, flags, 825, "Validity in days");
  CLI::App* token = AddAction(*command, "token", "Create tokens and add them to FOLDER/tokens",
                              "keys anna:submitter rack:worker", flags, exit_code, MakeTokens);
  token->add_option("NAME:ROLE", flags->tokens, "Token name and role: viewer, submitter, worker or admin")->required();
  AddDays(*token, flags, 365, "Validity in days; 0: until revoked");
  CLI::App* revoke =
      AddAction(*command, "revoke", "Revoke tokens, effective at once", "keys vera", flags, exit_code, RevokeTokens);
  revoke->add_option("NAME", flags->names, "Names of tokens")->required();
  CLI::App* caller = AddAction(*command, "caller", "Create client certificates, for tesserad --tls-ca", "keys rack-7",
                               flags, exit_code, MakeCallers);
  caller->add_option("NAME", flags->names, "Names of clients")->required();
  AddDays(*caller, flags, 825, "Validity in days");
}

}  // namespace tessera
