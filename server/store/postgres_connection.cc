#include "server/store/postgres_connection.h"

#include <libpq-fe.h>
#include <poll.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <iterator>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "server/store/state_store.h"

namespace tessera {
namespace {

constexpr int64_t kMicro = 1'000'000;

int64_t NowUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

using ConnectionOptions = std::unique_ptr<PQconninfoOption, void (*)(PQconninfoOption*)>;

ConnectionOptions ParseOptions(const std::string& url) {
  char* error = nullptr;
  ConnectionOptions options(PQconninfoParse(url.c_str(), &error), PQconninfoFree);
  PQfreemem(error);  // may quote the URL with its password
  return options;
}

std::string OptionOf(const ConnectionOptions& options, const std::string& keyword) {
  for (const PQconninfoOption* option = options.get(); option->keyword != nullptr; ++option) {
    if (option->keyword == keyword && option->val != nullptr) return option->val;
  }
  return "";
}

// Libpq's text in one line, without the end of a line.
std::string OneLine(const char* message) {
  std::string text = message != nullptr ? message : "";
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  std::erase(text, '\t');
  return Printable(text);
}

// The class of an error of the server, by its SQLSTATE.
absl::StatusCode CodeOf(const std::string& state) {
  const std::string kind = state.substr(0, 2);
  if (state == "53100") return absl::StatusCode::kResourceExhausted;  // disk full
  // Lost connections, resources, serialization and deadlocks, locks, shutdown and timeouts, a server that became
  // read-only.
  if (kind == "08" || kind == "53" || kind == "40" || state == "55P03" || kind == "57" || state == "25006") {
    return absl::StatusCode::kUnavailable;
  }
  if (state == "XX001" || state == "XX002") return absl::StatusCode::kDataLoss;  // damaged table or index
  if (state == "42501" || kind == "28") return absl::StatusCode::kPermissionDenied;
  return absl::StatusCode::kInternal;
}

int DigitOf(char c) { return c <= '9' ? c - '0' : c - 'a' + 10; }

}  // namespace

PostgresRows::PostgresRows(pg_result* result) : result_(result, PQclear) {}
int PostgresRows::size() const { return PQntuples(result_.get()); }
bool PostgresRows::IsNull(int row, int column) const { return PQgetisnull(result_.get(), row, column) != 0; }
int64_t PostgresRows::Int(int row, int column) const {
  return std::strtoll(PQgetvalue(result_.get(), row, column), nullptr, 10);
}
double PostgresRows::Real(int row, int column) const {
  return std::strtod(PQgetvalue(result_.get(), row, column), nullptr);
}
std::string PostgresRows::Text(int row, int column) const {
  return {PQgetvalue(result_.get(), row, column), static_cast<size_t>(PQgetlength(result_.get(), row, column))};
}

std::string PostgresRows::Bytes(int row, int column) const {
  const char* const hex = PQgetvalue(result_.get(), row, column);  // "\x616263"
  const auto digits = static_cast<size_t>(PQgetlength(result_.get(), row, column));
  std::string bytes(digits < 2 ? 0 : digits / 2 - 1, '\0');
  for (size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(DigitOf(hex[2 * i + 2]) << 4 | DigitOf(hex[2 * i + 3]));
  }
  return bytes;
}

StatusOr<PostgresTarget> ParsePostgresUrl(const std::string& url) {
  const ConnectionOptions options = ParseOptions(url);
  // With an unescaped '@', '/' or ':' in a password, libpq takes parts of it for something else, which messages show.
  const auto has = [&](const char* keyword, const char* characters) {
    return OptionOf(options, keyword).find_first_of(characters) != std::string::npos;
  };
  if (options == nullptr || has("host", "@") || has("dbname", "@") ||
      OptionOf(options, "port").find_first_not_of("0123456789,") != std::string::npos) {
    return absl::InvalidArgumentError(
        "found an address of a database that libpq cannot read, expected postgresql://USER@HOST:PORT/DATABASE; write "
        "special characters with %, for example @ as %40");
  }
  std::string location = "postgresql://";
  if (const std::string user = OptionOf(options, "user"); !user.empty()) absl::StrAppend(&location, user, "@");
  absl::StrAppend(&location, OptionOf(options, "host"));
  if (const std::string port = OptionOf(options, "port"); !port.empty()) absl::StrAppend(&location, ":", port);
  absl::StrAppend(&location, "/", OptionOf(options, "dbname"));
  if (const std::string service = OptionOf(options, "service"); !service.empty()) {
    absl::StrAppend(&location, "?service=", service);
  }
  return PostgresTarget{url, Printable(location), ""};
}

bool HasPassword(const std::string& url) {
  if (!IsPostgresUrl(url)) return false;
  const ConnectionOptions options = ParseOptions(url);
  return options != nullptr && (!OptionOf(options, "password").empty() || !OptionOf(options, "sslpassword").empty());
}

StatusOr<std::unique_ptr<PostgresConnection>> PostgresConnection::Open(const PostgresTarget& target, double limit_s) {
  // The last value of a keyword counts: first what the URL may change.
  const std::pair<const char*, const char*> parameters[] = {
      {"connect_timeout", "2"},         {"tcp_user_timeout", "5000"},   {"keepalives_idle", "5"},
      {"keepalives_interval", "2"},     {"keepalives_count", "3"},      {"target_session_attrs", "read-write"},
      {"application_name", "tesserad"}, {"dbname", target.url.c_str()}, {"client_encoding", "UTF8"}};
  const char *keywords[std::size(parameters) + 1] = {}, *values[std::size(parameters) + 1] = {};
  for (size_t i = 0; i < std::size(parameters); ++i) std::tie(keywords[i], values[i]) = parameters[i];
  std::unique_ptr<PostgresConnection> opened(new PostgresConnection(target, limit_s));
  opened->connection_ = PQconnectdbParams(keywords, values, /*expand_dbname=*/1);
  if (opened->connection_ == nullptr || PQstatus(opened->connection_) != CONNECTION_OK) {
    return opened->Broken(OneLine(PQerrorMessage(opened->connection_)));
  }
  PQsetnonblocking(opened->connection_, 1);
  PQsetNoticeProcessor(
      opened->connection_, [](void*, const char*) {}, nullptr);
  const std::string limit_ms = std::to_string(static_cast<int>(limit_s * 1000));
  // Whatever the defaults of role and database are. A synchronous standby waits as it is configured.
  TESSERA_RETURN_IF_ERROR(
      opened
          ->Run(absl::StrCat(
              "SET statement_timeout = ", limit_ms,
              "; SET default_transaction_isolation = 'read committed'; SET standard_conforming_strings = on; ",
              "SET bytea_output = 'hex'; SET idle_in_transaction_session_timeout = '60s'; ",
              "SELECT set_config('synchronous_commit', 'on', false)",
              " WHERE current_setting('synchronous_commit') <> 'remote_apply'",
              target.schema.empty() ? "" : absl::StrCat("; SET search_path = ", SqlName(target.schema), ", pg_temp")))
          .status());
  return opened;
}

PostgresConnection::~PostgresConnection() { PQfinish(connection_); }

Status PostgresConnection::Broken(const std::string& what) {
  broken_ = true;
  return absl::UnavailableError(absl::StrCat(location_, ": ", what));
}

Status PostgresConnection::ServerError(const pg_result* result) {
  const char* const state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  error_code_ = state != nullptr ? state : "";
  if (state == nullptr || PQstatus(connection_) != CONNECTION_OK) return Broken(OneLine(PQresultErrorMessage(result)));
  // Look for another host.
  if (error_code_ == "25006" || error_code_.starts_with("57P")) broken_ = true;
  // The primary message alone: others may quote the statement.
  return Status(CodeOf(error_code_),
                absl::StrCat(location_, ": ", OneLine(PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY))));
}

// Waits until data can be read or, if `write`, written.
Status PostgresConnection::Await(int64_t until_us, bool write) {
  pollfd waited = {PQsocket(connection_), static_cast<short>(write ? POLLIN | POLLOUT : POLLIN), 0};
  const int64_t left_ms = (until_us - NowUs() + 999) / 1000;
  const int ready = left_ms > 0 ? ::poll(&waited, 1, static_cast<int>(left_ms)) : 0;
  if (ready > 0 || (ready < 0 && errno == EINTR)) return absl::OkStatus();
  return Broken(absl::StrCat("no answer within ", limit_s_, " s"));
}

StatusOr<PostgresRows> PostgresConnection::Run(const std::string& sql) {
  if (broken_) return Broken("the connection is lost");
  error_code_.clear();
  // One message of the simple protocol: parameters would go in messages of their own, and a process that is stopped
  // between two of them would keep its locks.
  const int64_t until_us = NowUs() + static_cast<int64_t>(limit_s_ * kMicro);
  if (PQsendQuery(connection_, sql.c_str()) == 0) return Broken(OneLine(PQerrorMessage(connection_)));
  for (int left = 1; left != 0;) {
    left = PQflush(connection_);
    if (left < 0) return Broken(OneLine(PQerrorMessage(connection_)));
    if (left == 0) break;
    TESSERA_RETURN_IF_ERROR(Await(until_us, /*write=*/true));
    if (PQconsumeInput(connection_) == 0) return Broken(OneLine(PQerrorMessage(connection_)));
  }
  Status status;
  PostgresRows rows(nullptr);
  while (true) {
    while (PQisBusy(connection_) != 0) {
      TESSERA_RETURN_IF_ERROR(Await(until_us, /*write=*/false));
      if (PQconsumeInput(connection_) == 0) return Broken(OneLine(PQerrorMessage(connection_)));
    }
    pg_result* const result = PQgetResult(connection_);
    if (result == nullptr) break;
    rows = PostgresRows(result);
    const ExecStatusType kind = PQresultStatus(result);
    if (kind != PGRES_TUPLES_OK && kind != PGRES_COMMAND_OK) status = ServerError(result);
  }
  if (!status.ok()) return status;
  return rows;
}

void AppendHex(std::string& to, std::string_view bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  const size_t begin = to.size();
  to.resize(begin + 2 * bytes.size());
  char* out = to.data() + begin;
  for (const char c : bytes) {
    *out++ = kDigits[static_cast<unsigned char>(c) >> 4];
    *out++ = kDigits[static_cast<unsigned char>(c) & 15];
  }
}

std::string SqlBytes(std::string_view bytes) {
  std::string literal = "'\\x";
  AppendHex(literal, bytes);
  return literal + "'::bytea";
}

namespace {

std::string Quoted(std::string_view text, char quote) {
  std::string quoted(1, quote);
  for (const char c : text) {
    if (c == quote) quoted += quote;
    quoted += c;
  }
  return quoted + quote;
}

}  // namespace

// standard_conforming_strings is on: no other character is special.
std::string SqlText(std::string_view text) { return Quoted(text, '\''); }
std::string SqlName(std::string_view name) { return Quoted(name, '"'); }

}  // namespace tessera
