// Multipart uploads and copies.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <mutex>

#include "common/s3/s3_client.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "tests/support/fake_clock.h"
#include "tests/support/scripted_http_server.h"

namespace tessera {
namespace {

using testing::HasSubstr;

bool Has(const ScriptedRequest& request, const std::string& text) {
  return request.target.find(text) != std::string::npos;
}

ScriptedAnswer XmlAnswer(const std::string& xml, int status = 200) {
  ScriptedAnswer answer;
  answer.status = status;
  answer.body = "<?xml version=\"1.0\"?>" + xml;
  return answer;
}

// A store of uploads of one key.
class S3PartsTest : public testing::Test {
 protected:
  S3PartsTest() {
    const S3Location location = ParseS3Url("s3://bucket", server_.url(), "").value();
    S3ClientOptions options;
    options.retry.max_attempts = 3;
    options.sleeper = [](double) { return true; };
    options.max_put_bytes = 1000;
    options.min_part_bytes = 400;
    options.parts_at_once = 3;
    client_ = S3Client::Create(location, credentials_.get(), &clock_, options).value();
    for (int i = 0; i < 1500; ++i) content_.push_back(static_cast<char>('a' + i % 23));
  }

  ScriptedAnswer Answer(const ScriptedRequest& request) {
    const std::lock_guard lock(mutex_);
    if (request.method == "POST" && Has(request, "uploads=")) {
      return XmlAnswer("<InitiateMultipartUploadResult><UploadId>id+1</UploadId></InitiateMultipartUploadResult>");
    }
    if (request.method == "PUT" && Has(request, "partNumber=")) {
      const int number = std::stoi(request.target.substr(request.target.find("partNumber=") + 11));
      if (number == failing_part_) return XmlAnswer("<Error><Code>AccessDenied</Code></Error>", 403);
      if (request.headers.contains("x-amz-copy-source")) {
        ranges_.push_back(request.headers.at("x-amz-copy-source-range"));
        return XmlAnswer("<CopyPartResult><ETag>\"e\"</ETag></CopyPartResult>");
      }
      EXPECT_EQ(request.headers.at("x-amz-content-sha256"), Sha256Hex(request.body));
      parts_[number] = request.body;
      ScriptedAnswer answer;
      answer.headers["ETag"] = "\"0123456789abcdef0123456789abcdef\"";
      return answer;
    }
    if (request.method == "PUT" && request.headers.contains("x-amz-copy-source")) return copy_answer_;
    if (request.method == "POST") {
      completed_ = request.body;
      return complete_answer_;
    }
    if (request.method == "DELETE") {
      aborted_ = Has(request, "uploadId=id%2B1");
      return XmlAnswer("", 204);
    }
    if (request.method == "HEAD") {
      ScriptedAnswer answer;
      answer.headers = {
          {"ETag", head_etag_}, {"Last-Modified", "Fri, 24 May 2013 00:00:00 GMT"}, {"Content-Length", head_bytes_}};
      return answer;
    }
    stored_ = request.body;
    return XmlAnswer("");
  }
  Status PutContent() {
    const std::string path = folder_.path() + "/file";
    EXPECT_TRUE(WriteFileAtomic(path, content_).ok());
    return client_->PutFile("key", path, static_cast<int64_t>(content_.size()), sha256_.value_or(Sha256Hex(content_)));
  }
  std::string Joined() {
    std::string joined;
    for (const auto& [number, part] : parts_) joined += part;
    return joined;
  }

  std::mutex mutex_;
  std::string content_;
  std::optional<std::string> sha256_;
  int failing_part_ = 0;
  ScriptedAnswer complete_answer_ =
      XmlAnswer("<CompleteMultipartUploadResult><ETag>\"e-4\"</ETag></CompleteMultipartUploadResult>");
  ScriptedAnswer copy_answer_ = XmlAnswer("<CopyObjectResult><ETag>\"e\"</ETag></CopyObjectResult>");
  std::string head_etag_ = "\"e\"", head_bytes_ = "7";
  std::map<int, std::string> parts_;
  std::vector<std::string> ranges_;
  std::string completed_, stored_;
  bool aborted_ = false;
  TempFolder folder_ = TempFolder::Create("").value();
  FakeClock clock_;
  std::unique_ptr<S3CredentialsSource> credentials_ = FixedS3Credentials({"A", "S", "", 0});
  ScriptedHttpServer server_{[this](const ScriptedRequest& request) { return Answer(request); }};
  std::unique_ptr<S3Client> client_;
};

TEST_F(S3PartsTest, SendsASmallFileAtOnce) {
  content_.resize(1000);
  EXPECT_TRUE(PutContent().ok());
  EXPECT_EQ(stored_, content_);
  EXPECT_EQ(server_.requests().size(), 1u);
}

TEST_F(S3PartsTest, SendsALargeFileInParts) {
  const Status status = PutContent();
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(Joined(), content_);
  EXPECT_EQ(parts_.size(), 4u);
  EXPECT_EQ(parts_[4].size(), 300u);
  EXPECT_THAT(completed_, HasSubstr("<Part><PartNumber>4</PartNumber><ETag>&quot;0123456789abcdef0123456789abcdef"));
  EXPECT_FALSE(aborted_);
}

TEST_F(S3PartsTest, AbortsAfterAnError) {
  failing_part_ = 2;
  EXPECT_EQ(PutContent().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_TRUE(aborted_);
  EXPECT_TRUE(completed_.empty());
}

TEST_F(S3PartsTest, AbortsIfTheFileHasAnotherHash) {
  sha256_ = Sha256Hex("other");
  EXPECT_EQ(PutContent().code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(aborted_);
  EXPECT_TRUE(completed_.empty());
}

TEST_F(S3PartsTest, AbortsIfTheFileIsShorter) {
  const std::string path = folder_.path() + "/short";
  EXPECT_TRUE(WriteFileAtomic(path, content_).ok());
  EXPECT_EQ(client_->PutFile("key", path, 2000, Sha256Hex(content_)).code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(aborted_);
  EXPECT_EQ(client_->PutFile("key", folder_.path() + "/none", 2000, Sha256Hex("")).code(), absl::StatusCode::kNotFound);
  EXPECT_TRUE(WriteFileAtomic(path, "abc").ok());
  EXPECT_EQ(client_->PutFile("key", path, 4, Sha256Hex("abcd")).code(), absl::StatusCode::kDataLoss);
}

TEST_F(S3PartsTest, SeesAnErrorInAnAnswerWithStatus200) {
  complete_answer_ = XmlAnswer("\n <Error><Code>InternalError</Code><Message>try again</Message></Error>");
  EXPECT_EQ(PutContent().code(), absl::StatusCode::kUnavailable);
  EXPECT_TRUE(aborted_);
  copy_answer_ = XmlAnswer("<Error><Code>NoSuchKey</Code></Error>");
  EXPECT_FALSE(client_->Renew("key").ok());
}

TEST_F(S3PartsTest, AnUploadThatIsGoneWasCompletedIfItsObjectIsThere) {
  complete_answer_ = XmlAnswer("<Error><Code>NoSuchUpload</Code></Error>", 404);
  EXPECT_EQ(PutContent().code(), absl::StatusCode::kNotFound);
  head_etag_ = "\"6d7e6be2d4ddf8a54c1b6b2f7d4c3a9e-4\"";
  EXPECT_EQ(PutContent().code(), absl::StatusCode::kNotFound) << "another object";
  // The MD5 of four times the bytes 0123456789abcdef0123456789abcdef.
  head_etag_ = "\"7274a0a64b50788835a043985a075775-4\"";
  EXPECT_TRUE(PutContent().ok());
}

TEST_F(S3PartsTest, RenewsByACopyOntoItself) {
  EXPECT_TRUE(client_->Renew("a b").ok());
  const ScriptedRequest request = server_.requests()[0];
  EXPECT_EQ(request.target, "/bucket/a%20b");
  EXPECT_EQ(request.headers.at("x-amz-copy-source"), "/bucket/a%20b");
  EXPECT_EQ(request.headers.at("x-amz-metadata-directive"), "REPLACE");
  copy_answer_ = XmlAnswer("<Error><Code>NoSuchKey</Code></Error>", 404);
  EXPECT_EQ(client_->Renew("a b").code(), absl::StatusCode::kNotFound);
}

TEST_F(S3PartsTest, CopiesMoreThan5GiBInParts) {
  copy_answer_ = XmlAnswer("<Error><Code>InvalidRequest</Code></Error>", 400);
  EXPECT_EQ(client_->Renew("key").code(), absl::StatusCode::kInvalidArgument) << "a small object";
  head_bytes_ = std::to_string((int64_t{6} << 30) + 1);
  EXPECT_TRUE(client_->Renew("key").ok());
  ASSERT_EQ(ranges_.size(), 7u);
  EXPECT_EQ(ranges_[0], "bytes=0-1073741823");
  EXPECT_EQ(ranges_[6], "bytes=6442450944-6442450944");
  EXPECT_FALSE(aborted_);
  failing_part_ = 3;
  EXPECT_FALSE(client_->Renew("key").ok());
  EXPECT_TRUE(aborted_);
}

}  // namespace
}  // namespace tessera
