// S3Client against a server that gives what no good server gives.
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/s3/s3_client.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "tests/support/fake_clock.h"
#include "tests/support/scripted_http_server.h"

namespace tessera {

inline constexpr char kSecretKey[] = "secret-key-of-the-test", kToken[] = "session-token-of-the-test";
inline constexpr char kServerDate[] = "Tue, 14 Nov 2023 22:13:20 GMT";  // FakeClock's

// Answers of a store.
inline ScriptedAnswer ErrorAnswer(int status, const std::string& code, const std::string& message = "a reason") {
  ScriptedAnswer answer;
  answer.status = status;
  answer.headers["Date"] = kServerDate;
  answer.body = "<?xml version=\"1.0\"?><Error><Code>" + code + "</Code><Message>" + message + "</Message></Error>";
  return answer;
}

inline ScriptedAnswer ObjectAnswer(const std::string& body, const std::string& etag = "e1") {
  ScriptedAnswer answer;
  answer.headers = {{"ETag", "\"" + etag + "\""}, {"Last-Modified", "Fri, 24 May 2013 00:00:00 GMT"}};
  answer.body = body;
  return answer;
}

inline int64_t RangeStart(const ScriptedRequest& request) {
  const auto range = request.headers.find("range");
  return range == request.headers.end() ? 0 : std::stoll(range->second.substr(6));
}

inline ScriptedAnswer PartOf(const std::string& object, int64_t begin, const std::string& etag = "e1") {
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

}  // namespace tessera
