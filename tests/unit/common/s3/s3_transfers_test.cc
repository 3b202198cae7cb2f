// Downloads of S3Client, and requests by signed URLs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "tests/unit/common/s3/s3_client_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;

class S3TransfersTest : public S3ClientTest {};

// --- Reading ---

TEST_F(S3TransfersTest, ReadsRanges) {
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

TEST_F(S3TransfersTest, RefusesOtherRangesThanAskedFor) {
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

TEST_F(S3TransfersTest, RefusesAnAnswerThatIgnoresTheRange) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer("01"); });
  EXPECT_EQ(client_->Get("key", 1, 10).status().code(), absl::StatusCode::kInternal);
  EXPECT_EQ(client_->Stream("key", 1, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInternal);
}

TEST_F(S3TransfersTest, AStreamGoesOnWhereItWasCut) {
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

TEST_F(S3TransfersTest, AStreamEndsIfTheObjectChanged) {
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

TEST_F(S3TransfersTest, AStreamGivesUpWithoutProgress) {
  Serve([](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("0123456789");
    answer.cut_after = 0;
    return answer;
  });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kUnavailable);
  EXPECT_EQ(server_->requests().size(), 4u);
}

TEST_F(S3TransfersTest, TheTakerEndsAStream) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer("0123456789"); });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::UnavailableError("mine"); }),
            absl::UnavailableError("mine"));
  EXPECT_EQ(server_->requests().size(), 1u);
}

TEST_F(S3TransfersTest, AnAnswerMustSayItsLength) {
  Serve([](const ScriptedRequest&) {
    ScriptedAnswer answer = ObjectAnswer("0123456789");
    answer.declared_bytes = -2;
    return answer;
  });
  EXPECT_EQ(client_->Stream("key", 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInternal);
  EXPECT_EQ(client_->Head("key").status().code(), absl::StatusCode::kInternal);
}

TEST_F(S3TransfersTest, StreamsAnEmptyObject) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  EXPECT_TRUE(client_->Stream("key", 0, [](std::string_view) { return absl::InternalError("called"); }).ok());
}

// --- Signed URLs ---

TEST_F(S3TransfersTest, SignedUrlsNeedNoCredentials) {
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

  const SignedRequest put = client_->SignPut("key", Sha256Hex("ell"), 3, 60).value();
  EXPECT_THAT(put.url, HasSubstr("X-Amz-SignedHeaders=content-length%3Bhost%3Bx-amz-content-sha256"));
  EXPECT_EQ(put.headers.at("x-amz-content-sha256"), Sha256Hex("ell"));
  EXPECT_EQ(transfers.Put(put, File("hello"), 1, 3).value(), "e1");
  EXPECT_EQ(server_->requests().back().body, "ell");
  EXPECT_EQ(transfers.Put(put, File("hello"), 0, 5).status().code(), absl::StatusCode::kDataLoss) << "another size";
  EXPECT_EQ(server_->requests().back().body, "ell");
  EXPECT_EQ(server_->requests().back().headers.at("x-amz-content-sha256"), Sha256Hex("ell"));
  EXPECT_FALSE(server_->requests().back().headers.contains("authorization"));
  const SignedRequest part = client_->SignPart("key", "id/1", 3, Sha256Hex("x"), 1, 60, SignedHash::kChecksum).value();
  EXPECT_THAT(part.url, HasSubstr("&partNumber=3&uploadId=id%2F1&"));
  EXPECT_TRUE(part.headers.contains("x-amz-checksum-sha256"));
  EXPECT_EQ(client_->SignPut("key", Sha256Hex("x"), 1, 60, SignedHash::kNone)->headers.size(), 1u) << "the size alone";
}

TEST_F(S3TransfersTest, ARefusedUrlIsToldWithoutItsSignature) {
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

TEST_F(S3TransfersTest, RefusesHeadersThatSmuggle) {
  Serve([](const ScriptedRequest&) { return ObjectAnswer(""); });
  SignedTransfers transfers(options_);
  const SignedRequest request{"GET", server_->url() + "/x", {{"a", "b\r\nc: d"}}};
  EXPECT_EQ(transfers.Get(request, 0, [](std::string_view) { return absl::OkStatus(); }).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(
      transfers.Get({"GET", "file:///etc/passwd", {}}, 0, [](std::string_view) { return absl::OkStatus(); }).code(),
      absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace tessera
