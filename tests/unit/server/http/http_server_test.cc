// The API, sessions and streams over a connection.
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "server/http/routes.h"
#include "server/http/sessions.h"
#include "server/http/shared_answers.h"
#include "tests/unit/server/http/http_fixture.h"
#include "tests/unit/server/http/inflated.h"

namespace tessera {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

TEST_F(HttpTest, LogsInAndOut) {
  EXPECT_EQ(Ask("GET", "/api/v1/session", {}).status, 401);
  EXPECT_EQ(LogIn(RandomSecret()).status, 401);
  const HttpReply begun = LogIn(tokens_["submitter"]);
  ASSERT_EQ(begun.status, 200);
  const std::string cookie = begun.Header("set-cookie");
  EXPECT_TRUE(cookie.starts_with("tessera_session="));
  for (const char* const attribute : {"; HttpOnly", "; SameSite=Strict", "; Path=/"}) {
    EXPECT_THAT(cookie, HasSubstr(attribute));
  }
  EXPECT_THAT(cookie, Not(HasSubstr("Secure"))) << "there is no TLS";
  EXPECT_THAT(begun.body + cookie, Not(HasSubstr(tokens_["submitter"])));
  const SentHeaders session = {{"Cookie", "other=1; " + cookie.substr(0, cookie.find(';'))}, kChange};
  const HttpReply answer = Ask("GET", "/api/v1/session", session);
  ASSERT_EQ(answer.status, 200);
  EXPECT_EQ(answer.Header("cache-control"), "no-store");
  const json who = json::parse(answer.body);
  EXPECT_EQ(who["name"], "submitter");
  EXPECT_EQ(who["role"], "submitter");
  EXPECT_EQ(who["tokensRequired"], true);
  EXPECT_EQ(who["version"], "1.2.3");
  EXPECT_EQ(who["httpsOnly"], false);
  const auto may = who["may"].get<std::vector<std::string>>();
  EXPECT_THAT(may, Contains("/tessera.v1.Jobs/CreateJob"));
  EXPECT_THAT(may, Not(Contains("/tessera.v1.Jobs/DeleteJob")));
  const HttpReply ended = Ask("DELETE", "/api/v1/session", session);
  EXPECT_EQ(ended.status, 200);
  EXPECT_THAT(ended.Header("set-cookie"), HasSubstr("Max-Age=0"));
  EXPECT_EQ(Ask("GET", "/api/v1/session", session).status, 401);
  for (const char* const body : {"", "{", "[]", "{\"token\":7}", "{\"token\":\"\"}"}) {
    const int status = Ask("POST", "/api/v1/session", {kChange}, body).status;
    EXPECT_TRUE(status == 400 || status == 401) << body << ": " << status;
  }
}

TEST_F(HttpTest, WithoutTokensOnlyOwnNamesAreServed) {
  AskForNothing();
  const HttpReply answer = Ask("GET", "/api/v1/session", {});
  ASSERT_EQ(answer.status, 200) << answer.body;
  const json who = json::parse(answer.body);
  EXPECT_EQ(who["name"], "");
  EXPECT_EQ(who["role"], "admin");
  EXPECT_EQ(who["tokensRequired"], false);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", {}).status, 200);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", {{"Host", "localhost:8080"}}).status, 200);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", {{"Host", "[::1]:8080"}}).status, 200);
  // The page of another site whose name was made to lead here.
  for (const char* const host :
       {"evil.example", "evil.example:8080", "127.0.0.1.evil.example", "localhost.evil.example", ""}) {
    EXPECT_EQ(Ask("GET", "/api/v1/jobs", {{"Host", host}}).status, 403) << host;
  }
}

TEST_F(HttpTest, TokensThatDoNotExistAreCountedAndLoggedOnce) {
  testing::internal::CaptureStderr();
  ASSERT_TRUE(SetUpLog("info", false).ok());
  int refused = 0, too_many = 0;
  HttpConnection connection(Address());
  for (int i = 0; i < 1000; ++i) {
    const int status = connection.Ask("GET", "/api/v1/jobs", {{"Authorization", "Bearer " + RandomSecret()}}).status;
    refused += status == 401;
    too_many += status == 429;
  }
  EXPECT_EQ(refused, GuessLimits::kMaxFailures);
  EXPECT_EQ(too_many, 1000 - GuessLimits::kMaxFailures);
  const HttpReply last = LogIn("guess");
  EXPECT_EQ(last.status, 429);
  EXPECT_NE(last.Header("retry-after"), "");
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", Bearer("viewer")).status, 200) << "who has a token is not locked out";
  EXPECT_EQ(LogIn(tokens_["viewer"]).status, 200);
  ASSERT_TRUE(SetUpLog("off", false).ok());
  std::istringstream log(testing::internal::GetCapturedStderr());
  int lines = 0;
  for (std::string line; std::getline(log, line);) lines += line.find("tokens that do not exist") != std::string::npos;
  EXPECT_EQ(lines, 1);
}

TEST_F(HttpTest, ListsAreSharedAndKnownByTheirEtag) {
  for (int i = 0; i < 40; ++i) Create(AJob(2));
  const HttpReply first = Ask("GET", "/api/v1/jobs?pageSize=30", Session("viewer"));
  ASSERT_EQ(first.status, 200);
  EXPECT_EQ(first.Header("content-type"), "application/json; charset=utf-8");
  const json page = json::parse(first.body);
  EXPECT_EQ(page["jobs"].size(), 30u);
  EXPECT_EQ(page["jobs"][0]["name"], "jobs/40");
  EXPECT_NE(page["nextPageToken"], "");
  SentHeaders again = Bearer("admin");
  again.emplace_back("If-None-Match", first.Header("etag"));
  const HttpReply same = Ask("GET", "/api/v1/jobs?pageSize=30", again);
  EXPECT_EQ(same.status, 304);
  EXPECT_EQ(same.Header("etag"), first.Header("etag"));
  EXPECT_EQ(Ask("GET", "/api/v1/jobs?pageSize=20", again).status, 200);
  SentHeaders packs = Bearer("viewer");
  packs.emplace_back("Accept-Encoding", "gzip, deflate, br");
  const HttpReply packed = Ask("GET", "/api/v1/jobs?pageSize=30", packs);
  EXPECT_EQ(packed.Header("content-encoding"), "gzip");
  EXPECT_LT(packed.body.size(), first.body.size() / 3);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs?pageSize=x", Bearer("viewer")).status, 400);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs?page=1", Bearer("viewer")).status, 400);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs?pageSize=30", Bearer("worker")).status, 403) << "shared with nobody who may not";
}

TEST_F(HttpTest, ErrorsHaveTheStatusOfTheCall) {
  const SentHeaders admin = Bearer("admin");
  const HttpReply missing = Ask("GET", "/api/v1/jobs/99", admin);
  EXPECT_EQ(missing.status, 404);
  EXPECT_EQ(json::parse(missing.body)["code"], "NOT_FOUND");
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/99:state", admin).status, 404);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/99:watch", admin).status, 404);
  EXPECT_EQ(Ask("GET", "/files/jobs/99/mesh.ply", admin).status, 404);
  EXPECT_EQ(Ask("GET", "/api/v1/none", admin).status, 404);
  EXPECT_EQ(Ask("PUT", "/api/v1/jobs", admin, "{}").status, 405);
  EXPECT_EQ(Ask("POST", "/api/v1/jobs", admin, "{").status, 400);
  EXPECT_EQ(Ask("POST", "/api/v1/jobs", admin, "{\"unknown\":1}").status, 400);
  Create(AJob(2));
  EXPECT_EQ(Ask("DELETE", "/api/v1/jobs/1", admin).status, 409) << "it has not ended";
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/1?name=jobs%2F2", admin).status, 200);
}

TEST_F(HttpTest, CallsAreThoseOfTheServicesWithTheirAuditAndLimits) {
  testing::internal::CaptureStderr();
  ASSERT_TRUE(SetUpLog("info", false).ok());
  const json create = {{"scenePath", scene_}, {"settings", {{"tiles", 2}}}, {"displayName", "a\nb"}};
  const HttpReply refused = Ask("POST", "/api/v1/jobs", Session("viewer"), create.dump());
  EXPECT_EQ(refused.status, 403);
  const HttpReply created = Ask("POST", "/api/v1/jobs", Session("submitter"), create.dump());
  ASSERT_TRUE(SetUpLog("off", false).ok());
  ASSERT_EQ(created.status, 200) << created.body;
  EXPECT_EQ(json::parse(created.body)["name"], "jobs/1");
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_THAT(log, HasSubstr("audit action=CreateJob outcome=OK peer=ipv4:127.0.0.1:"));
  EXPECT_THAT(log, HasSubstr("user=submitter job=jobs/1"));
  EXPECT_THAT(log, HasSubstr("audit action=CreateJob outcome=PERMISSION_DENIED peer=ipv4:127.0.0.1:"));
  const auto calls = [&](const std::string& name) {
    int64_t count = 0;
    for (const auto& method : server_->rpc_counts().methods()) {
      if (method->name == name) count = method->codes[0];
    }
    return count;
  };
  EXPECT_EQ(calls("Jobs/CreateJob"), 1);
  const HttpReply paused = Ask("PATCH", "/api/v1/jobs/1", Session("submitter"), "{\"paused\":true}");
  EXPECT_EQ(json::parse(paused.body)["paused"], true);
  EXPECT_EQ(json::parse(Ask("POST", "/api/v1/jobs/1:cancel", Session("submitter"), "").body)["state"],
            "JOB_STATE_CANCELLED");
}

TEST_F(HttpTest, RequestsAreCountedByRoute) {
  HttpCounts counts(HttpRouteNames());
  options_http_.counts = &counts;
  StartHttp();
  const auto count = [&](const std::string& route, int status_class) {
    for (const auto& each : counts.routes()) {
      if (each->name == route) return each->classes[static_cast<size_t>(status_class - 1)].load();
    }
    return int64_t{-1};
  };
  const SentHeaders viewer = Session("viewer");
  const HttpReply list = Ask("GET", "/api/v1/jobs", viewer);
  ASSERT_EQ(list.status, 200);
  EXPECT_EQ(Ask("HEAD", "/api/v1/jobs", viewer).status, 200);
  SentHeaders seen = viewer;
  seen.emplace_back("If-None-Match", list.Header("etag"));
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", seen).status, 304);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/77", viewer).status, 404);
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/77", {}).status, 401);
  EXPECT_EQ(Ask("GET", "/<script>", viewer).status, 404);
  HttpConnection wrong(Address());
  wrong.Send("GARBAGE\r\n\r\n");
  EXPECT_EQ(wrong.Answer().status, 400);
  EXPECT_EQ(count("GET /api/v1/jobs", 2), 2);
  EXPECT_EQ(count("GET /api/v1/jobs", 3), 1);
  EXPECT_EQ(count("GET /api/v1/jobs/{job}", 4), 2);
  EXPECT_EQ(count("POST /api/v1/session", 2), 1);
  EXPECT_EQ(count("other", 4), 2);
  http_.reset();  // before the counts
}

TEST(SharedAnswersTest, AnswersThatTakeLongAreKeptLonger) {
  using std::chrono::milliseconds;
  EXPECT_EQ(SharedAnswers::AgeOf(milliseconds(1)), milliseconds(400));
  EXPECT_EQ(SharedAnswers::AgeOf(milliseconds(20)), milliseconds(1000));
  EXPECT_EQ(SharedAnswers::AgeOf(milliseconds(10'000)), milliseconds(3000));
}

// Appends the next chunk of an answer; false at its end.
bool NextChunk(HttpConnection& stream, std::string* bytes) {
  while (true) {
    std::string& raw = stream.received();
    const size_t line = raw.find("\r\n");
    const size_t size = line == std::string::npos ? 0 : std::strtoul(raw.c_str(), nullptr, 16);
    if (line != std::string::npos && size == 0) return false;
    if (line != std::string::npos && raw.size() >= line + 4 + size) {
      *bytes += raw.substr(line + 2, size);
      raw.erase(0, line + 4 + size);
      return true;
    }
    if (!stream.Receive()) return false;
  }
}

// The next event of a stream; empty at its end.
std::string NextEvent(HttpConnection& stream, std::string* text) {
  while (text->find("\n\n") == std::string::npos) {
    if (!NextChunk(stream, text)) return "";
  }
  const std::string event = text->substr(0, text->find("\n\n"));
  text->erase(0, event.size() + 2);
  return event;
}

TEST_F(HttpTest, StreamsTellEachChangeUntilTheJobEnds) {
  const std::string job = Create(AJob(2));
  HttpConnection stream(Address());
  stream.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", Session("viewer"), "", Address()));
  const HttpReply head = stream.Head();
  ASSERT_EQ(head.status, 200);
  EXPECT_EQ(head.Header("content-type"), "text/event-stream");
  std::string text;
  EXPECT_EQ(NextEvent(stream, &text), "retry: 2000");
  const std::string first = NextEvent(stream, &text);
  ASSERT_TRUE(first.starts_with("id: ")) << first;
  const std::string etag = first.substr(4, first.find('\n') - 4);
  const json state = json::parse(first.substr(first.find("data: ") + 6));
  EXPECT_EQ(state["job"]["name"], job);
  EXPECT_EQ(state["etag"], etag);
  const HttpReply polled = Ask("GET", "/api/v1/jobs/1:state", Bearer("viewer"));
  EXPECT_EQ(polled.status, 200);
  EXPECT_EQ(polled.Header("etag"), "\"" + etag + "\"");
  SentHeaders has = Bearer("viewer");
  has.emplace_back("If-None-Match", "\"" + etag + "\"");
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/1:state", has).status, 304);
  // A stream that was broken and begins again gets no state twice.
  HttpConnection again(Address());
  SentHeaders resumed = Bearer("viewer");
  resumed.emplace_back("Last-Event-ID", etag);
  again.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", resumed, "", Address()));
  EXPECT_EQ(again.Head().status, 200);
  std::string text_again;
  EXPECT_EQ(NextEvent(again, &text_again), "retry: 2000");
  EXPECT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  EXPECT_THAT(NextEvent(stream, &text), HasSubstr("JOB_STATE_CANCELLED"));
  EXPECT_EQ(NextEvent(stream, &text), "event: end\ndata: {}");
  EXPECT_EQ(NextEvent(stream, &text), "");
  EXPECT_THAT(NextEvent(again, &text_again), HasSubstr("JOB_STATE_CANCELLED"));
  // The connection is good for another request.
  stream.received().clear();
  EXPECT_EQ(HttpAsk(Address(), "GET", "/api/v1/jobs/1", Bearer("viewer")).status, 200);
}

TEST_F(HttpTest, StreamsAreCompressedForThoseWhoAccept) {
  const std::string job = Create(AJob(2));
  HttpConnection stream(Address());
  SentHeaders accepts = Bearer("viewer");
  accepts.emplace_back("Accept-Encoding", "gzip, deflate, br");
  stream.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", accepts, "", Address()));
  EXPECT_EQ(stream.Head().Header("content-encoding"), "gzip");
  std::string bytes, text;
  bool whole = false;
  const auto await = [&](const std::string& awaited) {
    while (text.find(awaited) == std::string::npos && NextChunk(stream, &bytes)) text = Inflated(bytes, &whole);
    EXPECT_THAT(text, HasSubstr(awaited));
  };
  await("JOB_STATE_QUEUED");
  EXPECT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  await("JOB_STATE_CANCELLED");
  await("event: end\ndata: {}\n\n");
  while (NextChunk(stream, &bytes)) continue;
  Inflated(bytes, &whole);
  EXPECT_TRUE(whole);
}

TEST_F(HttpTest, StatesHaveAHundredRunningTasksWithoutKeys) {
  const std::string job = Create(AJob(130)), worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  for (int i = 0; i < 120; ++i) ASSERT_TRUE(Lease(Worker()));
  HttpConnection stream(Address());
  stream.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", Bearer("viewer"), "", Address()));
  EXPECT_EQ(stream.Head().status, 200);
  std::string text;
  EXPECT_EQ(NextEvent(stream, &text), "retry: 2000");
  const std::string event = NextEvent(stream, &text);
  const HttpReply state = Ask("GET", "/api/v1/jobs/1:state", Bearer("viewer"));
  EXPECT_EQ(json::parse(event.substr(event.find("data: ") + 6)), json::parse(state.body));
  EXPECT_EQ(json::parse(state.body)["running"].size(), 100u);
  EXPECT_EQ(json::parse(state.body)["running"][0]["key"], "");
}

TEST_F(HttpTest, StreamsEndWithTheirTokenOrSession) {
  Create(AJob(2));
  AddToken("leaving", Role::kViewer, 0);
  const SentHeaders session = Session("viewer");
  HttpConnection of_token(Address()), of_session(Address());
  of_token.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", Bearer("leaving"), "", Address()));
  of_session.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", session, "", Address()));
  EXPECT_EQ(of_token.Head().status, 200);
  EXPECT_EQ(of_session.Head().status, 200);
  Revoke("leaving");
  EXPECT_EQ(Ask("DELETE", "/api/v1/session", session).status, 200);
  for (HttpConnection* const stream : {&of_token, &of_session}) {
    std::string text, last;
    for (std::string event; !(event = NextEvent(*stream, &text)).empty();) last = event;
    EXPECT_THAT(last, HasSubstr("event: error"));
    EXPECT_THAT(last, HasSubstr("UNAUTHENTICATED"));
  }
}

TEST_F(HttpTest, ARequestMayFollowOneWhoseBodyCameInParts) {
  HttpConnection connection(Address());
  const SentHeaders headers = Bearer("submitter");
  const std::string body = "{\"name\": \"" + std::string(20'000, 'x') + "\"}";
  const std::string text = HttpConnection::Text("POST", "/api/v1/jobs", headers, body, Address());
  for (size_t at = 0; at < text.size(); at += 3000) {
    ASSERT_TRUE(connection.Send(std::string_view(text).substr(at, 3000)));
    EXPECT_FALSE(at + 3000 < text.size() && connection.Receive(20)) << "answered before the end";
  }
  EXPECT_EQ(connection.Answer().status, 400);
  EXPECT_EQ(connection.Ask("GET", "/api/v1/jobs", Bearer("viewer")).status, 200);
}

TEST_F(HttpTest, ThePageNeedsNoSession) {
  const HttpReply page = Ask("GET", "/", {});
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.Header("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.Header("cache-control"), "no-cache");
  EXPECT_THAT(page.Header("content-security-policy"), HasSubstr("default-src 'self'"));
  EXPECT_EQ(page.Header("referrer-policy"), "no-referrer");
  EXPECT_THAT(page.body, HasSubstr("<title>"));
  EXPECT_EQ(Ask("HEAD", "/", {}).Header("content-length"), std::to_string(page.body.size()));
  EXPECT_EQ(Ask("GET", "/assets/none.js", {}).status, 404);
  EXPECT_EQ(Ask("GET", "/assets/../index.html", {}).status, 404);
}

}  // namespace
}  // namespace tessera
