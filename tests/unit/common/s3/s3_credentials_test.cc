#include "common/s3/s3_credentials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "common/s3/aws_profile.h"
#include "common/s3/credential_process.h"
#include "common/storage/files.h"
#include "tests/support/fake_clock.h"
#include "tests/support/scripted_http_server.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr char kSecret[] = "SECRET-THAT-NO-MESSAGE-HAS";

class S3CredentialsTest : public testing::Test {
 protected:
  std::string File(const std::string& name, const std::string& content) {
    const std::string path = folder_.path() + "/" + name;
    EXPECT_TRUE(WriteFileAtomic(path, content).ok());
    return path;
  }
  // A program that prints the content of a file and counts its runs.
  std::string Process(const std::string& json) {
    const std::string path = File("credentials.json", json);
    return "echo run >> " + folder_.path() + "/runs; cat " + path;
  }
  size_t Runs() const {
    std::ifstream runs(folder_.path() + "/runs");
    size_t count = 0;
    for (std::string line; std::getline(runs, line);) ++count;
    return count;
  }
  std::string ExpiresIn(double seconds) const {
    const auto time = static_cast<time_t>(clock_.UnixTimeUs() / 1'000'000 + static_cast<int64_t>(seconds));
    char text[32];
    std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&time));
    return text;
  }

  TempFolder folder_ = TempFolder::Create("").value();
  FakeClock clock_;
};

TEST_F(S3CredentialsTest, ReadsAndErasesTheEnvironment) {
  ::setenv("AWS_ACCESS_KEY_ID", "KEY", 1);
  ::setenv("AWS_SECRET_ACCESS_KEY", kSecret, 1);
  ::setenv("AWS_SESSION_TOKEN", "TOKEN", 1);
  const auto first = DefaultS3Credentials(&clock_);
  for (const char* name : {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"}) {
    EXPECT_EQ(std::getenv(name), nullptr) << name;
  }
  const auto second = DefaultS3Credentials(&clock_);  // of the same process
  for (const auto& source : {first.get(), second.get()}) {
    const StatusOr<S3Credentials> credentials = source->Get();
    ASSERT_TRUE(credentials.ok()) << credentials.status();
    EXPECT_EQ(credentials->access_key, "KEY");
    EXPECT_EQ(credentials->secret_key, kSecret);
    EXPECT_EQ(credentials->session_token, "TOKEN");
  }
}

TEST_F(S3CredentialsTest, ReadsTheProfileOfSharedFiles) {
  const std::string credentials_file = File("credentials",
                                            "# comment\n[default]\naws_access_key_id = A\naws_secret_access_key=B\n\n"
                                            "[ other ]\naws_access_key_id=C\naws_secret_access_key= D\n"
                                            "aws_session_token =E=\n");
  std::map<std::string, std::string> environment = {{"AWS_SHARED_CREDENTIALS_FILE", credentials_file}};
  StatusOr<S3Credentials> credentials = S3CredentialsFrom(environment, &clock_)->Get();
  ASSERT_TRUE(credentials.ok()) << credentials.status();
  EXPECT_EQ(credentials->access_key, "A");
  EXPECT_EQ(credentials->secret_key, "B");
  environment["AWS_PROFILE"] = "other";
  credentials = S3CredentialsFrom(environment, &clock_)->Get();
  ASSERT_TRUE(credentials.ok()) << credentials.status();
  EXPECT_EQ(credentials->access_key, "C");
  EXPECT_EQ(credentials->secret_key, "D");
  EXPECT_EQ(credentials->session_token, "E=");
  environment["AWS_PROFILE"] = "none";
  const Status missing = S3CredentialsFrom(environment, &clock_)->Get().status();
  EXPECT_EQ(missing.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(missing.message()), HasSubstr("no profile 'none' (AWS_PROFILE)"));
}

TEST_F(S3CredentialsTest, ReadsChangedFilesAgain) {
  const std::string file = File("credentials", "[default]\naws_access_key_id=A\naws_secret_access_key=B\n");
  const auto source = S3CredentialsFrom({{"AWS_SHARED_CREDENTIALS_FILE", file}}, &clock_);
  EXPECT_EQ(source->Get()->access_key, "A");
  File("credentials", "[default]\naws_access_key_id=A2\naws_secret_access_key=B\n");
  EXPECT_EQ(source->Get()->access_key, "A2");
}

TEST_F(S3CredentialsTest, TheEnvironmentComesFirst) {
  const std::string file = File("credentials", "[default]\naws_access_key_id=A\naws_secret_access_key=B\n");
  const auto source = S3CredentialsFrom(
      {{"AWS_SHARED_CREDENTIALS_FILE", file}, {"AWS_ACCESS_KEY_ID", "E"}, {"AWS_SECRET_ACCESS_KEY", "S"}}, &clock_);
  EXPECT_EQ(source->Get()->access_key, "E");
}

TEST_F(S3CredentialsTest, RunsTheProcessAgainBeforeItsCredentialsExpire) {
  const auto json = [&](const std::string& key, double seconds) {
    return R"({"Version": 1, "AccessKeyId": ")" + key + R"(", "SecretAccessKey": "S", "SessionToken": "T",)" +
           R"("Expiration": ")" + ExpiresIn(seconds) + "\"}";
  };
  const std::string command = Process(json("P1", 3600));
  const std::string file = File("config", "[profile p]\nregion = x\ncredential_process = " + command + "\n");
  const auto source = S3CredentialsFrom({{"AWS_CONFIG_FILE", file}, {"AWS_PROFILE", "p"}}, &clock_);
  for (int i = 0; i < 3; ++i) {
    const StatusOr<S3Credentials> credentials = source->Get();
    ASSERT_TRUE(credentials.ok()) << credentials.status();
    EXPECT_EQ(credentials->access_key, "P1");
    EXPECT_EQ(credentials->session_token, "T");
  }
  EXPECT_EQ(Runs(), 1u);
  Process(json("P2", 7200));
  clock_.Advance(3600 - 290);
  EXPECT_EQ(source->Get()->access_key, "P2");
  EXPECT_EQ(Runs(), 2u);
}

TEST_F(S3CredentialsTest, OldCredentialsServeUntilTheyExpireIfTheProcessFails) {
  const std::string command =
      Process(R"({"Version":1,"AccessKeyId":"P","SecretAccessKey":"S","Expiration":")" + ExpiresIn(3600) + "\"}");
  const std::string file = File("config", "[default]\ncredential_process = " + command + "\n");
  const auto source = S3CredentialsFrom({{"AWS_CONFIG_FILE", file}}, &clock_);
  EXPECT_EQ(source->Get()->access_key, "P");
  Process("not JSON");
  clock_.Advance(3600 - 100);
  EXPECT_EQ(source->Get()->access_key, "P");
  EXPECT_EQ(source->Get()->access_key, "P");
  EXPECT_EQ(Runs(), 2u) << "a renewal that failed is not tried at each call";
  clock_.Advance(101);
  const Status expired = source->Get().status();
  EXPECT_EQ(expired.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(expired.message()), HasSubstr("credential_process of profile 'default'"));
}

TEST_F(S3CredentialsTest, TheProcessIsBounded) {
  EXPECT_THAT(std::string(RunCredentialProcess("sleep 60 & sleep 60", 0.2).status().message()),
              HasSubstr("did not end within 0.2 s"));
  EXPECT_THAT(std::string(RunCredentialProcess("yes", 20).status().message()), HasSubstr("more than 65536 bytes"));
  EXPECT_THAT(std::string(RunCredentialProcess("echo SECRET; exit 3", 20).status().message()),
              HasSubstr("ended with exit code 3"));
  EXPECT_EQ(RunCredentialProcess("cat; echo '{}'", 20).value(), "{}\n");  // no standard input
}

TEST_F(S3CredentialsTest, AsksTheContainerEndpoint) {
  ScriptedHttpServer server([&](const ScriptedRequest& request) {
    ScriptedAnswer answer;
    if (request.headers.at("authorization") != "container token") answer.status = 403;
    answer.body = R"({"AccessKeyId":"K","SecretAccessKey":"S","Token":"T","Expiration":")" + ExpiresIn(3600) + "\"}";
    return answer;
  });
  std::map<std::string, std::string> environment = {{"AWS_CONTAINER_CREDENTIALS_FULL_URI", server.url() + "/role"},
                                                    {"AWS_CONTAINER_AUTHORIZATION_TOKEN", "container token"}};
  StatusOr<S3Credentials> credentials = S3CredentialsFrom(environment, &clock_)->Get();
  ASSERT_TRUE(credentials.ok()) << credentials.status();
  EXPECT_EQ(credentials->access_key, "K");
  EXPECT_EQ(credentials->session_token, "T");
  environment["AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE"] = File("token", "another token\n");
  EXPECT_THAT(std::string(S3CredentialsFrom(environment, &clock_)->Get().status().message()),
              HasSubstr("HTTP status 403"));
  environment["AWS_CONTAINER_CREDENTIALS_FULL_URI"] = "http://127.0.0.1.example.org/role";
  EXPECT_THAT(std::string(S3CredentialsFrom(environment, &clock_)->Get().status().message()),
              HasSubstr("must be https"));
}

TEST_F(S3CredentialsTest, SaysWhereItLookedInVain) {
  const Status none = S3CredentialsFrom({{"HOME", folder_.path()}}, &clock_)->Get().status();
  EXPECT_EQ(none.code(), absl::StatusCode::kFailedPrecondition);
  for (const char* place : {"AWS_ACCESS_KEY_ID", "/.aws/credentials", "/.aws/config", "AWS_CONTAINER_CREDENTIALS"}) {
    EXPECT_THAT(std::string(none.message()), HasSubstr(place));
  }
}

TEST_F(S3CredentialsTest, NoMessageHasASecret) {
  const std::string broken = File("credentials", std::string("[default]\n") + kSecret + "\n");
  const std::string half = File("half", std::string("[default]\naws_secret_access_key=") + kSecret + "\n");
  const std::string blank =
      File("blank", std::string("[default]\naws_access_key_id=A\naws_secret_access_key=x ") + kSecret + "\n");
  const std::string process =
      File("process", std::string("[default]\ncredential_process = echo '{\"SecretAccessKey\":\"") + kSecret + "\"'\n");
  for (const std::string& file : {broken, half, blank, process}) {
    const Status status = S3CredentialsFrom({{"AWS_SHARED_CREDENTIALS_FILE", file}}, &clock_)->Get().status();
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition) << file;
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr(kSecret)));
  }
}

TEST_F(S3CredentialsTest, RefusesWrongJson) {
  for (const std::string json : {"", "[]", "{}", R"({"AccessKeyId":"A"})", R"({"AccessKeyId":"A","SecretAccessKey":1})",
                                 R"({"AccessKeyId":"A","SecretAccessKey":"a\nb"})",
                                 R"({"AccessKeyId":"A","SecretAccessKey":"B","Expiration":"soon"})"}) {
    EXPECT_EQ(ParseS3Credentials("json", json).status().code(), absl::StatusCode::kInvalidArgument) << json;
  }
  EXPECT_FALSE(ParseS3Credentials("json", std::string(100, '[')).ok());
  EXPECT_FALSE(ParseS3Credentials("json", std::string(100'000, ' ')).ok());
}

TEST_F(S3CredentialsTest, SkipsNestedSettings) {
  const StatusOr<AwsProfile> profile = ParseAwsProfile(
      "config", "[profile a]\ns3 =\n  max_concurrent_requests = 20\nregion = r\n[profile ab]\nregion = other\n", "a");
  ASSERT_TRUE(profile.ok()) << profile.status();
  EXPECT_EQ(*profile, (AwsProfile{{"s3", ""}, {"region", "r"}}));
}

}  // namespace
}  // namespace tessera
