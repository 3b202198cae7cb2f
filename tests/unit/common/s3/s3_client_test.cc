// S3Client against a server that gives what no good server gives. The real servers are tested with S3Blobs.
#include "common/s3/s3_client.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "common/base/refusal.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "tests/support/fake_clock.h"
#include "tests/support/scripted_http_server.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

constexpr char kSecretKey[] = "secret-key-of-the-test", kToken[] = "session-token-of-the-test";
constexpr char kServerDate[] = "Tue, 14 Nov 2023 22:13:20 GMT";  // FakeClock's

// Answers of a store.
ScriptedAnswer ErrorAnswer(int status, const std::string& code, const std::string& message = "a reason") {
  ScriptedAnswer answer;
  answer.status = status;
  answer.headers["Date"] = kServerDate;
  answer.body = "<?xml version=\"1.0\"?><Error><Code>" + code + "</Code><Message>" + message + "</Message></Error>";
  return answer;
}

ScriptedAnswer ObjectAnswer(const std::string& body, const std::string& etag = "e1") {
  ScriptedAnswer answer;
  answer.headers = {{"ETag", "\"" + etag + "\""}, {"Last-Modified", "Fri, 24 May 2013 00:00:00 GMT"}};
  answer.body = body;
  return answer;
}

int64_t RangeStart(const ScriptedRequest& request) {
  const auto range = request.headers.find("range");
  return range == request.headers.end() ? 0 : std::stoll(range->second.substr(6));
}

ScriptedAnswer PartOf(const std::string& object, int64_t begin, const std::string& etag = "e1") {
  ScriptedAnswer answer = ObjectAnswer(object.substr(static_cast<size_t>(begin)), etag);
  answer.status = 206;
  answer.headers["Content-Range"] =
      "bytes " + std::to_string(begin) + "-" + std::to_string(object.size() - 1) + "/" + std::to_string(object.size());
  return answer;
}

class S3ClientTest : public testing::Test {
 protected:
  void Serve(ScriptedHttpServer::Handler handler) {
    server_ = std::make_unique<ScriptedHttpServer>(std::move(handler));
    const S3Location location = ParseS3Url("s3://bucket/prefix", server_->url(), "").value();
    options_.retry.max_attempts = 4;
    options_.sleeper = [this](double seconds) {
      waits_.push_back(seconds);
      return waits_.size() < 100;
    };
    client_ = S3Client::Create(location, credentials_.get(), &clock_, options_).value();
  }
  std::string File(const std::string& content) {
    const std::string path = folder_.path() + "/file";
    EXPECT_TRUE(WriteFileAtomic(path, content).ok());
    return path;
  }
  Status PutHello() { return client_->Put("key", "hello", Sha256Hex("hello")); }

  FakeClock clock_;
  TempFolder folder_ = TempFolder::Create("").value();
  std::unique_ptr<S3CredentialsSource> credentials_ = FixedS3Credentials({"ACCESS", kSecretKey, kToken, 0});
  S3ClientOptions options_;
  std::vector<double> waits_;
  std::unique_ptr<ScriptedHttpServer> server_;
  std::unique_ptr<S3Client> client_;
};

TEST_F(S3ClientTest, SendsSignedRequestsOverOneConnection) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  EXPECT_TRUE(PutHello().ok());
  EXPECT_TRUE(PutHello().ok());
  EXPECT_TRUE(client_->Head("a b/ü+").ok());
  EXPECT_EQ(server_->connections(), 1u);
  const std::vector<ScriptedRequest> requests = server_->requests();
  EXPECT_EQ(requests[0].method, "PUT");
  EXPECT_EQ(requests[0].target, "/bucket/prefix/key");
  EXPECT_EQ(requests[0].body, "hello");
  EXPECT_EQ(requests[0].headers.at("x-amz-content-sha256"), Sha256Hex("hello"));
  EXPECT_EQ(requests[0].headers.at("x-amz-date"), "20231114T221320Z");
  EXPECT_THAT(requests[0].headers.at("authorization"), HasSubstr("Credential=ACCESS/20231114/us-east-1/s3/"));
  EXPECT_EQ(requests[2].target, "/bucket/prefix/a%20b/%C3%BC%2B");
  const S3Counts counts = client_->counts()["put"];
  EXPECT_EQ(counts.calls, 2);
  EXPECT_EQ(counts.sent_bytes, 10);
  EXPECT_EQ(counts.retries + counts.errors, 0);
}

TEST_F(S3ClientTest, RepeatsAfterTransientErrors) {
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest&) {
    switch (++calls) {
      case 1:
        return ErrorAnswer(503, "SlowDown");
      case 2:
        return ErrorAnswer(500, "InternalError");
      case 3: {
        ScriptedAnswer cut = ObjectAnswer("");
        cut.declared_bytes = 10;  // and closes the connection
        return cut;
      }
      default:
        return ObjectAnswer("");
    }
  });
  EXPECT_TRUE(PutHello().ok());
  EXPECT_EQ(server_->requests().back().body, "hello");
  ASSERT_EQ(waits_.size(), 3u);
  EXPECT_GT(waits_[2], waits_[0]);
  EXPECT_EQ(client_->counts()["put"].retries, 3);
  EXPECT_EQ(client_->counts()["put"].errors, 3);
}

TEST_F(S3ClientTest, EachCallHasItsOwnJitter) {
  Serve([](const ScriptedRequest&) { return ErrorAnswer(503, "SlowDown"); });
  EXPECT_FALSE(PutHello().ok());
  EXPECT_FALSE(PutHello().ok());
  ASSERT_EQ(waits_.size(), 6u);
  EXPECT_NE(waits_[0], waits_[3]);
}

TEST_F(S3ClientTest, WaitsAsLongAsTheStoreAsks) {
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest&) {
    ScriptedAnswer answer = ErrorAnswer(429, "TooManyRequests");
    answer.headers["Retry-After"] = "17";
    return ++calls == 1 ? answer : ObjectAnswer("");
  });
  EXPECT_TRUE(PutHello().ok());
  EXPECT_THAT(waits_, ElementsAre(17));
}

TEST_F(S3ClientTest, GivesUpAfterTheLastAttempt) {
  Serve([](const ScriptedRequest&) { return ErrorAnswer(503, "SlowDown", "reduce your rate"); });
  const Status status = PutHello();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("s3://bucket/prefix/key: SlowDown (HTTP 503): reduce your rate"));
  EXPECT_EQ(server_->requests().size(), 4u);
}

TEST_F(S3ClientTest, TheSleeperCancels) {
  options_.sleeper = nullptr;
  Serve([](const ScriptedRequest&) { return ErrorAnswer(503, "SlowDown"); });
  waits_.resize(100);
  EXPECT_EQ(PutHello().code(), absl::StatusCode::kCancelled);
}

TEST_F(S3ClientTest, EndsASilentTransfer) {
  options_.silence_s = 1;
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("0123456789");
    answer.silent = ++calls == 1;
    if (answer.silent) answer.cut_after = 4;
    return answer;
  });
  EXPECT_EQ(client_->Get("key", 0, 10).value(), "0123456789");
  EXPECT_EQ(calls, 2);
}

TEST_F(S3ClientTest, NoServerListens) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  server_.reset();
  const Status status = PutHello();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("127.0.0.1"));
}

TEST_F(S3ClientTest, TellsErrorsInWords) {
  const struct {
    int http_status;
    const char* code;
    absl::StatusCode expected;
    const char* words;
  } kCases[] = {
      {404, "NoSuchKey", absl::StatusCode::kNotFound, "NoSuchKey"},
      {404, "NoSuchBucket", absl::StatusCode::kFailedPrecondition, "create the bucket"},
      {403, "AccessDenied", absl::StatusCode::kPermissionDenied, "AccessDenied"},
      {403, "SignatureDoesNotMatch", absl::StatusCode::kFailedPrecondition, "check the credentials"},
      {403, "InvalidAccessKeyId", absl::StatusCode::kFailedPrecondition, "check the credentials"},
      {400, "ExpiredToken", absl::StatusCode::kFailedPrecondition, "renew the credentials"},
      {403, "QuotaExceeded", absl::StatusCode::kResourceExhausted, "QuotaExceeded"},
      {507, "", absl::StatusCode::kResourceExhausted, "(HTTP 507)"},
      {400, "BadDigest", absl::StatusCode::kDataLoss, "BadDigest"},
      {400, "XAmzContentSHA256Mismatch", absl::StatusCode::kDataLoss, "XAmzContentSHA256Mismatch"},
      {412, "PreconditionFailed", absl::StatusCode::kFailedPrecondition, "PreconditionFailed"},
      {301, "PermanentRedirect", absl::StatusCode::kFailedPrecondition, "--s3-region"},
      {400, "AuthorizationHeaderMalformed", absl::StatusCode::kFailedPrecondition, "--s3-region"},
      {400, "InvalidRequest", absl::StatusCode::kInvalidArgument, "InvalidRequest"},
      {501, "NotImplemented", absl::StatusCode::kInvalidArgument, "NotImplemented"},
  };
  std::atomic<int> now{0};
  Serve([&](const ScriptedRequest&) { return ErrorAnswer(kCases[now].http_status, kCases[now].code); });
  for (; now < static_cast<int>(std::size(kCases)); ++now) {
    const Status status = PutHello();
    EXPECT_EQ(status.code(), kCases[now].expected) << kCases[now].code;
    EXPECT_THAT(std::string(status.message()), HasSubstr(kCases[now].words));
  }
  EXPECT_TRUE(waits_.empty()) << "none of them is transient";
}

TEST_F(S3ClientTest, TellsBothTimesIfTheClocksDiffer) {
  Serve([](const ScriptedRequest& request) {
    ScriptedAnswer answer = ErrorAnswer(403, "RequestTimeTooSkewed");
    if (request.method == "HEAD") answer.body.clear();
    return answer;
  });
  clock_.SetBy(-3600);
  for (const Status& status : {PutHello(), client_->Head("key").status()}) {
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(status.message()), HasSubstr("this machine's says 2023-11-14 21:13:20 UTC"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("the store's 2023-11-14 22:13:20 UTC"));
  }
}

TEST_F(S3ClientTest, DoesNotFollowRedirects) {
  Serve([](const ScriptedRequest&) {
    ScriptedAnswer answer = ErrorAnswer(307, "TemporaryRedirect");
    answer.headers["Location"] = "http://127.0.0.1:1/elsewhere";
    answer.headers["x-amz-bucket-region"] = "eu-west-1";
    return answer;
  });
  const Status status = PutHello();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("in region eu-west-1"));
  EXPECT_EQ(server_->requests().size(), 1u);
}

TEST_F(S3ClientTest, NoMessageHasASecret) {
  Serve([](const ScriptedRequest& request) {
    return ErrorAnswer(403, "SignatureDoesNotMatch",
                       std::string(kSecretKey) + " " + kToken + " " + request.headers.at("x-amz-security-token"));
  });
  const std::string message(PutHello().message());
  EXPECT_THAT(message, Not(HasSubstr(kSecretKey)));
  EXPECT_THAT(message, Not(HasSubstr(kToken)));
  EXPECT_THAT(message, HasSubstr("*** ***"));
}

TEST_F(S3ClientTest, MessagesOfAStoreArePrintableAndShort) {
  Serve([](const ScriptedRequest&) {
    return ErrorAnswer(400, "Odd",
                       "\xc2\x9b"
                       "31m" +
                           std::string(10'000, 'x'));
  });
  const std::string message(PutHello().message());
  EXPECT_THAT(message, HasSubstr("\\u009b31m"));
  EXPECT_LT(message.size(), 1000u);
}

TEST_F(S3ClientTest, BoundsAnswers) {
  std::string huge = "<ListBucketResult>";
  huge.resize(20 << 20, ' ');
  const std::string answers[] = {
      huge,
      "<!DOCTYPE x [<!ENTITY a \"aaaa\">]><ListBucketResult>&a;</ListBucketResult>",
      "<html><body>It works!</body></html>",
      "",
      "<ListBucketResult><IsTruncated>true</IsTruncated></ListBucketResult>",
      "<ListBucketResult><Contents><Key>prefix/a</Key></Contents></ListBucketResult>",
      "<ListBucketResult><Contents><Key>other/a</Key><Size>1</Size><ETag>e</ETag>"
      "<LastModified>2013-05-24T00:00:00.000Z</LastModified></Contents></ListBucketResult>",
  };
  std::atomic<int> now{0};
  Serve([&](const ScriptedRequest&) { return ObjectAnswer(answers[now]); });
  for (; now < static_cast<int>(std::size(answers)); ++now) {
    EXPECT_EQ(client_->List("").status().code(), absl::StatusCode::kInternal) << answers[now].substr(0, 100);
  }
}

TEST_F(S3ClientTest, HugeErrorsAreCut) {
  Serve([](const ScriptedRequest&) { return ErrorAnswer(400, "Odd", std::string(20 << 20, 'x')); });
  const Status status = PutHello();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_LT(client_->counts()["put"].received_bytes, 2 << 20);
}

TEST_F(S3ClientTest, ListsPages) {
  Serve([](const ScriptedRequest& request) {
    const bool second = request.target.find("continuation-token=t%2F1") != std::string::npos;
    return ObjectAnswer(
        std::string("<?xml version=\"1.0\" encoding=\"UTF-8\"?><ListBucketResult xmlns=\"x\">"
                    "<EncodingType>url</EncodingType><IsTruncated>") +
        (second ? "false</IsTruncated>" : "true</IsTruncated><NextContinuationToken>t/1</NextContinuationToken>") +
        "<Contents><Key>prefix/a%26+b" + (second ? "2" : "1") +
        "</Key><LastModified>2013-05-24T00:00:00.000Z</LastModified><ETag>&quot;e&quot;</ETag><Size>7</Size>"
        "</Contents></ListBucketResult>");
  });
  const StatusOr<S3Page> first = client_->List("a");
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_EQ(first->objects.size(), 1u);
  EXPECT_EQ(first->objects[0].key, "a& b1");
  EXPECT_EQ(first->objects[0].size_bytes, 7);
  EXPECT_EQ(first->objects[0].etag, "e");
  EXPECT_EQ(first->objects[0].modified_us, int64_t{1'369'353'600} * 1'000'000);
  EXPECT_THAT(server_->requests()[0].target, HasSubstr("prefix=prefix%2Fa"));
  const StatusOr<S3Page> second = client_->List("a", first->next);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(second->objects[0].key, "a& b2");
  EXPECT_EQ(second->next, "");
}

TEST_F(S3ClientTest, DeletesInBatches) {
  Serve([](const ScriptedRequest&) {
    return ObjectAnswer("<DeleteResult><Error><Key>prefix/1</Key><Code>NoSuchKey</Code></Error></DeleteResult>");
  });
  std::vector<std::string> keys = {"a&<b>"};
  while (keys.size() < 1001) keys.push_back(std::to_string(keys.size()));
  EXPECT_TRUE(client_->Delete(keys).ok());
  ASSERT_EQ(server_->requests().size(), 2u);
  EXPECT_THAT(server_->requests()[0].body, HasSubstr("<Key>prefix/a&amp;&lt;b&gt;</Key>"));
  EXPECT_THAT(server_->requests()[0].headers.at("content-md5"), Not(HasSubstr(" ")));
  EXPECT_THAT(server_->requests()[1].body, HasSubstr("<Object><Key>prefix/1000</Key></Object></Delete>"));
}

TEST_F(S3ClientTest, RepeatsADeleteOfWhichAPartFailed) {
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest&) {
    const std::string code = ++calls == 1 ? "InternalError" : calls == 2 ? "AccessDenied" : "Odd";
    return ObjectAnswer("<DeleteResult><Error><Key>prefix/1</Key><Code>" + code + "</Code></Error></DeleteResult>");
  });
  EXPECT_EQ(client_->Delete({"1"}).code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(calls, 2);
}

// --- Reading ---

TEST_F(S3ClientTest, ReadsRanges) {
  const std::string object = "0123456789";
  Serve([&](const ScriptedRequest& request) {
    const int64_t begin = RangeStart(request);
    if (begin >= 10) return ErrorAnswer(416, "InvalidRange");
    ScriptedAnswer answer = PartOf(object, begin);
    if (request.headers.at("range") == "bytes=2-4") {
      answer.body = "234";
      answer.headers["Content-Range"] = "bytes 2-4/10";
    }
    return answer;
  });
  EXPECT_EQ(client_->Get("key", 2, 3).value(), "234");
  EXPECT_EQ(client_->Get("key", 5, 100).value(), "56789");
  EXPECT_EQ(client_->Get("key", 10, 5).value(), "");
  EXPECT_EQ(client_->Get("key", 0, 0).value(), "");
}

TEST_F(S3ClientTest, RefusesOtherRangesThanAskedFor) {
  const char* const ranges[] = {"bytes 3-5/10", "bytes 2-12/10", "bytes 4-2/10", "bytes 2-4/*", "2-4/10", "",
                                "bytes 2-4/11x"};
  std::atomic<int> now{0};
  Serve([&](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("234");
    answer.status = 206;
    answer.headers["Content-Range"] = ranges[now];
    return answer;
  });
  for (; now < static_cast<int>(std::size(ranges)); ++now) {
    EXPECT_EQ(client_->Get("key", 2, 3).status().code(), absl::StatusCode::kInternal) << ranges[now];
  }
}

TEST_F(S3ClientTest, RefusesAnAnswerThatIgnoresTheRange) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer("01"); });
  EXPECT_EQ(client_->Get("key", 1, 10).status().code(), absl::StatusCode::kInternal);
  EXPECT_EQ(client_->Stream("key", 1, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInternal);
}

TEST_F(S3ClientTest, AStreamGoesOnWhereItWasCut) {
  const std::string object = "0123456789";
  Serve([&](const ScriptedRequest& request) {
    const int64_t begin = RangeStart(request);
    ScriptedAnswer answer = begin == 0 ? ObjectAnswer(object) : PartOf(object, begin);
    answer.cut_after = 1;  // more cuts than attempts
    return answer;
  });
  std::string got;
  const Status status = client_->Stream("key", 0, [&](std::string_view bytes) {
    got += bytes;
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(got, object);
  EXPECT_FALSE(server_->requests()[0].headers.contains("if-match"));
  EXPECT_EQ(server_->requests()[3].headers.at("if-match"), "\"e1\"");
  EXPECT_EQ(server_->requests()[3].headers.at("range"), "bytes=3-");
}

TEST_F(S3ClientTest, AStreamEndsIfTheObjectChanged) {
  const std::string object = "0123456789";
  std::atomic<bool> honest{true};
  Serve([&](const ScriptedRequest& request) {
    if (RangeStart(request) > 0) return honest ? ErrorAnswer(412, "PreconditionFailed") : PartOf(object, 3, "e2");
    ScriptedAnswer answer = ObjectAnswer(object);
    answer.cut_after = 3;
    return answer;
  });
  for (const bool value : {true, false}) {
    honest = value;
    std::string got;
    const Status status = client_->Stream("key", 0, [&](std::string_view bytes) {
      got += bytes;
      return absl::OkStatus();
    });
    EXPECT_EQ(status.code(), absl::StatusCode::kAborted) << status;
    EXPECT_EQ(got, "012");
  }
}

TEST_F(S3ClientTest, AStreamGivesUpWithoutProgress) {
  Serve([](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("0123456789");
    answer.cut_after = 0;
    return answer;
  });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kUnavailable);
  EXPECT_EQ(server_->requests().size(), 4u);
}

TEST_F(S3ClientTest, TheTakerEndsAStream) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer("0123456789"); });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::UnavailableError("mine"); }),
            absl::UnavailableError("mine"));
  EXPECT_EQ(server_->requests().size(), 1u);
}

TEST_F(S3ClientTest, AnAnswerMustSayItsLength) {
  Serve([](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("0123456789");
    answer.declared_bytes = -2;
    return answer;
  });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInternal);
  EXPECT_EQ(client_->Head("key").status().code(), absl::StatusCode::kInternal);
}

TEST_F(S3ClientTest, StreamsAnEmptyObject) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  EXPECT_TRUE(client_->Stream("key", 0, [](std::string_view) { return absl::InternalError("called"); }).ok());
}

// --- Signed URLs ---

TEST_F(S3ClientTest, SignedUrlsNeedNoCredentials) {
  const std::string object = "0123456789";
  Serve([&](const ScriptedRequest& request) {
    const int64_t begin = RangeStart(request);
    ScriptedAnswer answer = begin == 0 ? ObjectAnswer(object) : PartOf(object, begin);
    if (request.method == "GET") answer.cut_after = 4;
    return answer;
  });
  SignedTransfers transfers(options_);
  const SignedRequest get = client_->SignGet("key", 60).value();
  EXPECT_THAT(get.url, HasSubstr("/bucket/prefix/key?X-Amz-Algorithm=AWS4-HMAC-SHA256&"));
  EXPECT_THAT(get.url, HasSubstr("X-Amz-Expires=60&"));
  EXPECT_TRUE(get.headers.empty());
  std::string got;
  const Status status = transfers.Get(get, 2, [&](std::string_view bytes) {
    got += bytes;
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(got, "23456789");

  const SignedRequest put = client_->SignPut("key", Sha256Hex("ell"), 60).value();
  EXPECT_THAT(put.url, HasSubstr("X-Amz-SignedHeaders=host%3Bx-amz-content-sha256"));
  EXPECT_EQ(put.headers.at("x-amz-content-sha256"), Sha256Hex("ell"));
  EXPECT_EQ(transfers.Put(put, File("hello"), 1, 3).value(), "e1");
  EXPECT_EQ(server_->requests().back().body, "ell");
  EXPECT_EQ(server_->requests().back().headers.at("x-amz-content-sha256"), Sha256Hex("ell"));
  EXPECT_FALSE(server_->requests().back().headers.contains("authorization"));
  const SignedRequest part = client_->SignPart("key", "id/1", 3, Sha256Hex("x"), 60, SignedHash::kChecksum).value();
  EXPECT_THAT(part.url, HasSubstr("&partNumber=3&uploadId=id%2F1&"));
  EXPECT_TRUE(part.headers.contains("x-amz-checksum-sha256"));
  EXPECT_TRUE(client_->SignPut("key", Sha256Hex("x"), 60, SignedHash::kNone)->headers.empty());
}

TEST_F(S3ClientTest, ARefusedUrlIsToldWithoutItsSignature) {
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest& request) {
    return ErrorAnswer(403, ++calls == 1 ? "AccessDenied" : "SignatureDoesNotMatch",
                       "Request has expired: " + request.target.substr(request.target.rfind('=') + 1));
  });
  const SignedRequest get = client_->SignGet("key", 60).value();
  SignedTransfers transfers(options_);
  for (int i = 0; i < 2; ++i) {
    const Status status = transfers.Get(get, 0, [](std::string_view) { return absl::OkStatus(); });
    EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("/bucket/prefix/key: "));
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr(get.url.substr(get.url.rfind('=') + 1))));
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("X-Amz")));
  }
}

TEST_F(S3ClientTest, RefusesHeadersThatSmuggle) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  SignedTransfers transfers(options_);
  const SignedRequest request{"GET", server_->url() + "/x", {{"a", "b\r\nc: d"}}};
  EXPECT_EQ(transfers.Get(request, 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(
      transfers.Get({"GET", "file:///etc/passwd", {}}, 0, [](std::string_view) { return absl::OkStatus(); }).code(),
      absl::StatusCode::kInvalidArgument);
}

TEST_F(S3ClientTest, NamesAnAuthoritiesFileThatIsMissing) {
  const S3Location location = ParseS3Url("s3://bucket", "https://localhost", "").value();
  const Status status =
      S3Client::Create(location, credentials_.get(), &clock_, {.ca_file = folder_.path() + "/ca.pem"}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/ca.pem"));
}

}  // namespace
}  // namespace tessera
