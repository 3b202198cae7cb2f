// S3Client against a server that gives what no good server gives. The real servers are tested with S3Blobs.
#include "common/s3/s3_client.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "tests/unit/common/s3/s3_client_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

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

TEST_F(S3ClientTest, RepeatsAfterAnAnswerThatIsNotHttp) {
  std::atomic<int> calls{0};
  Serve([&](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("the beginning of the next answer on this connection");
    answer.status = ++calls == 1 ? 204 : 200;  // 204 has no body
    return answer;
  });
  EXPECT_TRUE(PutHello().ok());
  EXPECT_TRUE(PutHello().ok());
  EXPECT_EQ(waits_.size(), 1u);
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

TEST_F(S3ClientTest, NamesAnAuthoritiesFileThatIsMissing) {
  const S3Location location = ParseS3Url("s3://bucket", "https://localhost", "").value();
  const Status status =
      S3Client::Create(location, credentials_.get(), &clock_, {.ca_file = folder_.path() + "/ca.pem"}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/ca.pem"));
}

}  // namespace
}  // namespace tessera
