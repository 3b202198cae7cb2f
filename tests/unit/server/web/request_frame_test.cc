#include "server/web/request_frame.h"

#include <gtest/gtest.h>

#include <string>

namespace tessera {
namespace {

using State = RequestFrame::State;

RequestFrame Find(const std::string& bytes) { return FindRequest(bytes, FrameLimits()); }
int RefusalOf(const std::string& bytes) {
  const RequestFrame frame = Find(bytes);
  return frame.state == State::kRefused ? frame.refusal : 0;
}

TEST(RequestFrame, FindsTheEndOfARequest) {
  const std::string first = "POST /api/v1/jobs?a=1 HTTP/1.1\r\nHost: a\r\nContent-Length: 4\r\nX-A: b\r\n\r\nbody";
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(Find(first.substr(0, i)).state, State::kIncomplete) << i;
  }
  const RequestFrame frame = Find(first + "GET / HTTP/1.1\r\n");
  ASSERT_EQ(frame.state, State::kComplete);
  EXPECT_EQ(frame.size_bytes, first.size());
  EXPECT_EQ(frame.body_bytes, 4u);
  EXPECT_EQ(frame.method, "POST");
  EXPECT_EQ(frame.target, "/api/v1/jobs?a=1");
  EXPECT_EQ(frame.head, "POST /api/v1/jobs?a=1 HTTP/1.1\r\nHost: a\r\nX-A: b\r\n\r\n");
}

TEST(RequestFrame, KeepsHeadersOfTheServerApart) {
  const RequestFrame frame = Find(
      "GET / HTTP/1.1\r\nhost: a\r\nrange: bytes=0-1\r\nACCEPT-ENCODING: gzip, br\r\nExpect: 100-continue\r\n\r\n");
  ASSERT_EQ(frame.state, State::kComplete);
  EXPECT_EQ(frame.range, "bytes=0-1");
  EXPECT_EQ(frame.accept_encoding, "gzip, br");
  EXPECT_EQ(frame.expect, "100-continue");
  EXPECT_EQ(frame.head, "GET / HTTP/1.1\r\nhost: a\r\n\r\n");
}

TEST(RequestFrame, SkipsEmptyLinesBeforeARequest) {
  const RequestFrame frame = Find("\r\n\r\nGET / HTTP/1.0\r\n\r\n");
  ASSERT_EQ(frame.state, State::kComplete);
  EXPECT_EQ(frame.size_bytes, 22u);
}

TEST(RequestFrame, RefusesWhatIsTooLarge) {
  const std::string get = "GET / HTTP/1.1\r\nHost: a\r\n";
  EXPECT_EQ(RefusalOf("GET /" + std::string(5000, 'a') + " HTTP/1.1\r\nHost: a\r\n\r\n"), 414);
  EXPECT_EQ(RefusalOf(std::string(20'000, 'a')), 414);
  EXPECT_EQ(RefusalOf(get + "X: " + std::string(20'000, 'a')), 431);
  std::string many = get;
  for (int i = 0; i < 101; ++i) many += "X: y\r\n";
  EXPECT_EQ(RefusalOf(many + "\r\n"), 431);
  EXPECT_EQ(RefusalOf(get + "Content-Length: 1048577\r\n\r\n"), 413);
  EXPECT_EQ(RefusalOf(get + "Content-Length: 1073741824\r\n\r\n"), 413);
  EXPECT_EQ(RefusalOf(get + "Content-Length: 99999999999999999999999\r\n\r\n"), 413);
  EXPECT_EQ(Find(get + "Content-Length: 1048576\r\n\r\n").state, State::kIncomplete);
}

TEST(RequestFrame, RefusesWhatParsersUnderstandDifferently) {
  const std::string get = "GET / HTTP/1.1\r\nHost: a\r\n";
  EXPECT_EQ(RefusalOf(get + "Content-Length: 1\r\nContent-Length: 2\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Content-Length: 1\r\nContent-Length: 1\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Content-Length: +1\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Content-Length: -1\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Content-Length: 0x1\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n"), 501);
  EXPECT_EQ(RefusalOf(get + "Host: b\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf("GET / HTTP/1.1\r\n\r\n"), 400) << "no host";
  EXPECT_EQ(RefusalOf(get + " folded: a\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "Name : a\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "no colon\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf(get + "X: a\nContent-Length: 5\r\n\r\n"), 400) << "a line without a carriage return";
  EXPECT_EQ(RefusalOf(get + std::string("X: a\0b\r\n\r\n", 10)), 400);
  EXPECT_EQ(RefusalOf("GET http://a/ HTTP/1.1\r\nHost: a\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf("GET  / HTTP/1.1\r\nHost: a\r\n\r\n"), 400);
  EXPECT_EQ(RefusalOf("GET / HTTP/2.0\r\nHost: a\r\n\r\n"), 505);
  EXPECT_EQ(RefusalOf("\x16\x03\x01\x02 a client of TLS\r\n\r\n"), 400);
}

}  // namespace
}  // namespace tessera
