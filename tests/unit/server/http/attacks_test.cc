// Bounds of the HTTP server; gRPC must not notice when they are reached.
#include <sys/resource.h>

#include <chrono>
#include <fstream>
#include <list>
#include <thread>

#include "tests/unit/server/http/http_fixture.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

double SecondsSince(Steady::time_point start) { return std::chrono::duration<double>(Steady::now() - start).count(); }

int64_t MemoryBytes() {
  std::ifstream statm("/proc/self/statm");
  int64_t pages = 0, resident = 0;
  statm >> pages >> resident;
  return resident * 4096;
}

class AttacksTest : public HttpTest {
 protected:
  AttacksTest() {
    rlimit files = {};
    ::getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = files.rlim_max;
    ::setrlimit(RLIMIT_NOFILE, &files);
    options_http_.limits.request_s = 1.5;
    options_http_.limits.idle_s = 3;
    options_http_.limits.stall_s = 1;
    StartHttp();
    Create(AJob(2));
  }
  // Publishes a file "large" as a file of jobs/2.
  void PublishLarge(const std::string& content) {
    EXPECT_TRUE(coordinator_->jobs().CancelJob("jobs/1").ok());
    Create(AJob(1));
    const std::string worker = Worker();
    while (auto lease = Lease(worker)) {
      ReportedResult result = Result(*lease);
      if (lease->plan.kind == "publish") result.outputs.push_back({"large", *blobs_->PutBytes(content)});
      EXPECT_TRUE(Settled(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result)).ok());
    }
  }
  // Readers of that file that do not read.
  void ReadSlowly(int count, std::list<HttpConnection>* readers) {
    for (int i = 0; i < count; ++i) {
      readers->emplace_back(Address());
      const int small = 4096;
      ::setsockopt(readers->back().fd(), SOL_SOCKET, SO_RCVBUF, &small, sizeof(small));
      readers->back().Send(HttpConnection::Text("GET", "/files/jobs/2/large", Bearer("viewer"), "", Address()));
    }
  }
  // gRPC and the API answer at once.
  void ExpectService(const std::string& during) {
    Steady::time_point start = Steady::now();
    EXPECT_TRUE(ListOverRpc().ok()) << during;
    EXPECT_LT(SecondsSince(start), 2) << during;
    start = Steady::now();
    EXPECT_EQ(Ask("GET", "/api/v1/jobs", Bearer("viewer")).status, 200) << during;
    EXPECT_LT(SecondsSince(start), 3) << during;
    EXPECT_LE(http_->threads(), 16 + 8 + 24 + 64) << during;
  }
};

TEST_F(AttacksTest, AHugeBodyIsRefusedByItsLength) {
  const int64_t before = MemoryBytes();
  HttpConnection connection(Address());
  connection.Send("POST /api/v1/jobs HTTP/1.1\r\nHost: a\r\nX-Tessera: 1\r\nContent-Length: 1073741824\r\n\r\n");
  const std::string part(1 << 20, 'x');
  int sent_mib = 0;
  while (sent_mib < 1024 && connection.Send(part)) ++sent_mib;
  EXPECT_LT(sent_mib, 64) << "the server has read on";
  HttpConnection polite(Address());
  polite.Send("POST /api/v1/jobs HTTP/1.1\r\nHost: a\r\nExpect: 100-continue\r\nContent-Length: 1073741824\r\n\r\n");
  EXPECT_EQ(polite.Answer().status, 413);
  EXPECT_TRUE(polite.Ends(5000));
  HttpConnection chunked(Address());
  chunked.Send("POST /api/v1/jobs HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n");
  EXPECT_EQ(chunked.Answer().status, 501);
  ExpectService("huge bodies");
  EXPECT_LT(MemoryBytes() - before, 64 << 20);
}

TEST_F(AttacksTest, ABodyThatIsSentAfterAWordIsRead) {
  HttpConnection connection(Address());
  const std::string body = "{\"token\":\"" + tokens_["viewer"] + "\"}";
  connection.Send(
      "POST /api/v1/session HTTP/1.1\r\nHost: a\r\nX-Tessera: 1\r\nExpect: 100-continue\r\nContent-Length: " +
      std::to_string(body.size()) + "\r\n\r\n");
  EXPECT_EQ(connection.Head().status, 100);
  connection.Send(body);
  EXPECT_EQ(connection.Answer().status, 200);
}

TEST_F(AttacksTest, SlowRequestsEndAndHoldNoThread) {
  std::list<HttpConnection> slow;
  for (int i = 0; i < 300; ++i) {
    slow.emplace_back(Address());
    ASSERT_TRUE(slow.back().connected());
    slow.back().Send("GET / HT");
  }
  const Steady::time_point start = Steady::now();
  ExpectService("300 slow requests");
  // A byte now and then does not prolong the time for the whole request.
  while (SecondsSince(start) < 2) {
    for (HttpConnection& connection : slow) connection.Send("T");
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  int ended = 0;
  for (HttpConnection& connection : slow) ended += connection.Ends(1000);
  EXPECT_EQ(ended, 300);
  ExpectService("after them");
}

TEST_F(AttacksTest, AThousandConnectionsLeaveRoom) {
  options_http_.limits.connections = 200;
  options_http_.limits.of_address = 150;
  StartHttp();
  std::list<HttpConnection> idle;
  for (int i = 0; i < 1000; ++i) idle.emplace_back(Address());
  // All come from one address, which has its limit; gRPC has its own connections.
  EXPECT_TRUE(ListOverRpc().ok());
  EXPECT_EQ(Ask("GET", "/api/v1/jobs", Bearer("viewer")).status, 503);
  idle.clear();
  int status = 0;
  for (int i = 0; i < 50 && status != 200; ++i) {
    status = Ask("GET", "/api/v1/jobs", Bearer("viewer")).status;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(status, 200) << "once they have left";
}

TEST_F(AttacksTest, OnlySoManyStreams) {
  std::list<HttpConnection> streams;
  const SentHeaders viewer = Bearer("viewer");
  int open = 0, refused = 0;
  for (int i = 0; i < 300; ++i) {
    streams.emplace_back(Address());
    streams.back().Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", viewer, "", Address()));
  }
  for (HttpConnection& stream : streams) {
    const HttpReply head = stream.Head();
    open += head.status == 200;
    refused += head.status == 503;
    if (head.status == 503) {
      EXPECT_NE(head.Header("retry-after"), "");
    }
  }
  EXPECT_EQ(open, 64);
  EXPECT_EQ(refused, 236);
  ExpectService("300 streams");
  EXPECT_EQ(Ask("GET", "/api/v1/jobs/1:state", viewer).status, 200) << "the others poll";
  streams.clear();
  // A stream's place is free soon after its reader has left.
  int status = 0;
  for (int i = 0; i < 50 && status != 200; ++i) {
    HttpConnection stream(Address());
    stream.Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", viewer, "", Address()));
    status = stream.Head().status;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(status, 200);
}

TEST_F(AttacksTest, SlowReadersAreDropped) {
  // A file that no buffer of a socket holds.
  const std::string content(64 << 20, 'f');
  PublishLarge(content);
  const int64_t before = MemoryBytes();
  std::list<HttpConnection> readers;
  ReadSlowly(20, &readers);
  ExpectService("20 slow readers");
  EXPECT_LT(MemoryBytes() - before, int64_t{400} << 20) << "the whole file is in memory several times";
  // All of them, in three rounds of 8 threads.
  std::this_thread::sleep_for(std::chrono::milliseconds(4500));
  EXPECT_EQ(Ask("GET", "/files/jobs/2/large", Bearer("viewer")).body.size(), content.size());
  for (HttpConnection& reader : readers) EXPECT_TRUE(reader.Ends(5000));
}

TEST_F(AttacksTest, SlowReadersOfFilesStopNoOtherCaller) {
  options_http_.limits.stall_s = 60;
  StartHttp();
  Create(AJob(2));
  const std::string content(64 << 20, 'f');
  PublishLarge(content);
  std::list<HttpConnection> readers;
  ReadSlowly(40, &readers);
  const Steady::time_point start = Steady::now();
  EXPECT_EQ(Ask("GET", "/files/jobs/2/large", Bearer("admin")).body.size(), content.size());
  EXPECT_LT(SecondsSince(start), 30) << "not when a slow reader is dropped";
  ExpectService("40 slow readers");
}

TEST_F(AttacksTest, SlowReadersOfListsHoldNoThread) {
  for (int i = 0; i < 700; ++i) Create(AJob(1));
  std::list<HttpConnection> readers;
  for (int i = 0; i < 100; ++i) {
    readers.emplace_back(Address());
    const int small = 4096;
    ::setsockopt(readers.back().fd(), SOL_SOCKET, SO_RCVBUF, &small, sizeof(small));
    // Twenty requests at once; none of their answers is read.
    std::string requests;
    for (int k = 0; k < 20; ++k) {
      requests += HttpConnection::Text("GET", "/api/v1/jobs?pageSize=700", Bearer("viewer"), "", Address());
    }
    readers.back().Send(requests);
  }
  ExpectService("100 readers that do not read");
}

TEST_F(AttacksTest, NonsenseEndsTheConnection) {
  for (const std::string& bytes :
       {std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 16),
        std::string("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"), std::string("GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"),
        std::string(100'000, 'a'), std::string("\r\n\r\nX\r\n\r\n"), std::string("GET /%zz HTTP/9.9\r\n\r\n")}) {
    HttpConnection connection(Address());
    connection.Send(bytes);
    const int status = connection.Answer().status;
    EXPECT_TRUE(status >= 400 && status <= 505) << status;
    EXPECT_TRUE(connection.Ends(5000));
  }
  ExpectService("nonsense");
}

TEST_F(AttacksTest, TheServerStopsWithOpenStreams) {
  std::list<HttpConnection> streams;
  for (int i = 0; i < 20; ++i) {
    streams.emplace_back(Address());
    streams.back().Send(HttpConnection::Text("GET", "/api/v1/jobs/1:watch", Bearer("viewer"), "", Address()));
    EXPECT_EQ(streams.back().Head().status, 200);
  }
  const Steady::time_point start = Steady::now();
  http_.reset();
  EXPECT_LT(SecondsSince(start), 5);
  for (HttpConnection& stream : streams) EXPECT_TRUE(stream.Ends(1000));
}

}  // namespace
}  // namespace tessera
