// Every route with every kind of visitor. A route without a row fails the test.
#include <set>

#include "server/http/routes.h"
#include "tests/unit/server/http/http_fixture.h"

namespace tessera {
namespace {

using Roles = std::set<std::string>;
const Roles kReaders = {"viewer", "submitter", "admin"}, kSubmitters = {"submitter", "admin"}, kAdmins = {"admin"},
            kAll = {"viewer", "submitter", "worker", "admin"};

struct Row {
  Roles roles;        // that may
  bool open = false;  // also without a session
};

const std::map<std::string, Row> kRows = {
    {"POST /api/v1/session", {kAll, true}},
    {"GET /api/v1/session", {kAll}},
    {"DELETE /api/v1/session", {kAll, true}},
    {"GET /api/v1/jobs", {kReaders}},
    {"POST /api/v1/jobs", {kSubmitters}},
    {"GET /api/v1/jobs/{job}", {kReaders}},
    {"PATCH /api/v1/jobs/{job}", {kSubmitters}},
    {"DELETE /api/v1/jobs/{job}", {kAdmins}},
    {"POST /api/v1/jobs/{job}:cancel", {kSubmitters}},
    {"POST /api/v1/jobs/{job}:retry", {kSubmitters}},
    {"POST /api/v1/jobs/{job}:export", {kSubmitters}},
    {"GET /api/v1/jobs/{job}:state", {kReaders}},
    {"GET /api/v1/jobs/{job}:watch", {kReaders}},
    {"GET /api/v1/jobs/{job}/tasks", {kReaders}},
    {"GET /api/v1/jobs/{job}/attempts", {kReaders}},
    {"GET /api/v1/jobs/{job}/tiles", {kReaders}},
    {"GET /api/v1/jobs/{job}/views", {kReaders}},
    {"GET /api/v1/jobs/{job}:locate", {kReaders}},
    {"GET /api/v1/jobs/{job}/artifacts", {kReaders}},
    {"GET /api/v1/workers", {kReaders}},
    {"GET /api/v1/settings", {kReaders}},
    {"POST /api/v1/quote", {kSubmitters}},
    {"GET /files/jobs/{job}/{name}", {kReaders}},
    {"GET /", {kAll, true}},
    {"GET /assets/{name}", {kAll, true}},
};

std::string RowOf(const Route& route) { return std::string(route.method) + " " + std::string(route.path); }

std::string TargetOf(const Route& route) {
  std::string target(route.path);
  const auto replace = [&](const std::string& what, const std::string& with) {
    if (const size_t at = target.find(what); at != std::string::npos) target.replace(at, what.size(), with);
  };
  replace("{job}", "1");
  replace("{name}", "mesh.ply");
  return target;
}

class AccessTableTest : public HttpTest {
 protected:
  AccessTableTest() { job_ = Create(AJob(2)); }
  // The status alone: a stream has no end.
  int StatusOf(const Route& route, const SentHeaders& headers) {
    HttpConnection connection(Address());
    const bool changes = route.method != "GET";
    connection.Send(
        HttpConnection::Text(std::string(route.method), TargetOf(route), headers, changes ? "{}" : "", Address()));
    const HttpReply answer = connection.Head();
    EXPECT_EQ(answer.headers.count("access-control-allow-origin"), 0u);
    EXPECT_EQ(answer.Header("x-content-type-options"), "nosniff");
    EXPECT_EQ(answer.headers.count("content-security-policy"), 1u);
    return answer.status;
  }
  std::string job_;
};

TEST_F(AccessTableTest, EveryRouteHasARow) {
  std::set<std::string> rows;
  for (const Route& route : Routes()) {
    rows.insert(RowOf(route));
    EXPECT_TRUE(kRows.contains(RowOf(route))) << RowOf(route) << " has no row";
  }
  for (const auto& [name, row] : kRows) EXPECT_TRUE(rows.contains(name)) << name << " has no route";
}

TEST_F(AccessTableTest, NobodyGetsMoreThanTheTokenGives) {
  ASSERT_EQ(job_, "jobs/1");
  AddToken("expiring", Role::kAdmin, clock_.UnixTimeUs() + 1'000'000);
  AddToken("leaving", Role::kAdmin, 0);
  const SentHeaders expired = Session("expiring"), revoked = Session("leaving");
  ASSERT_EQ(Ask("GET", "/api/v1/session", expired).status, 200);
  ASSERT_EQ(Ask("GET", "/api/v1/session", revoked).status, 200);
  clock_.Advance(2);
  Revoke("leaving");
  const std::map<std::string, SentHeaders> strangers = {
      {"no session", {kChange}},
      {"a session whose token has expired", expired},
      {"a session whose token was revoked", revoked},
      {"a stale cookie", {{"Cookie", "tessera_session=" + RandomSecret()}, kChange}},
      {"an empty cookie", {{"Cookie", "tessera_session="}, kChange}},
      {"a token as cookie", {{"Cookie", "tessera_session=" + tokens_["admin"]}, kChange}},
      {"another scheme", {{"Authorization", "Basic " + tokens_["admin"]}, kChange}},
      {"two tokens",
       {{"Authorization", "Bearer " + tokens_["viewer"]}, {"Authorization", "Bearer " + tokens_["admin"]}, kChange}},
  };
  const auto before = store_.records;
  for (const Route& route : Routes()) {
    const std::string name = RowOf(route);
    ASSERT_TRUE(kRows.contains(name));
    if (kRows.at(name).open) continue;
    for (const auto& [who, headers] : strangers) {
      const int status = StatusOf(route, headers);
      EXPECT_TRUE(status == 401 || status == 429) << name << " with " << who << ": " << status;
    }
  }
  std::map<std::string, SentHeaders> sessions;
  for (const char* role : kRoles) sessions[role] = Session(role);
  for (const Route& route : Routes()) {
    const std::string name = RowOf(route);
    for (const char* role : kRoles) {
      if (kRows.at(name).roles.contains(role)) continue;
      EXPECT_EQ(StatusOf(route, sessions[role]), 403) << name << " as " << role;
      EXPECT_EQ(StatusOf(route, Bearer(role)), 403) << name << " with the token of " << role;
    }
    if (route.method == "GET") continue;
    // What a page of another origin, or a form, can make a browser send.
    const auto& [cookie, value] = sessions["admin"][0];
    EXPECT_EQ(StatusOf(route, {{cookie, value}}), 403) << name << " without the header";
    EXPECT_EQ(StatusOf(route, {{cookie, value}, {"X-Tessera", "0"}}), 403) << name;
    for (const std::string& origin :
         {std::string("https://evil.example"), std::string("null"), std::string("http://127.0.0.1:1"),
          "http://evil.example#" + Address(), "http://" + Address() + ".evil.example"}) {
      EXPECT_EQ(StatusOf(route, {{cookie, value}, kChange, {"Origin", origin}}), 403) << name << " from " << origin;
    }
  }
  EXPECT_EQ(store_.records, before) << "a refused request changed state";
}

TEST_F(AccessTableTest, RolesDoWhatTheyMay) {
  std::map<std::string, SentHeaders> sessions;
  for (const char* role : kRoles) sessions[role] = Session(role);
  for (const Route& route : Routes()) {
    if (route.kind == RouteKind::kEndSession) continue;
    const std::string name = RowOf(route);
    for (const std::string& role : kRows.at(name).roles) {
      SentHeaders headers = sessions[role];
      headers.emplace_back("Origin", "http://" + Address());
      for (const SentHeaders& each : {headers, Bearer(role)}) {
        const int status = StatusOf(route, each);
        EXPECT_TRUE(status != 0 && status != 401 && status != 403) << name << " as " << role << ": " << status;
        EXPECT_LT(status, 500) << name << " as " << role;
      }
    }
  }
  EXPECT_EQ(Ask("DELETE", "/api/v1/session", sessions["viewer"]).status, 200);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", sessions["viewer"]).status, 401);
}

}  // namespace
}  // namespace tessera
