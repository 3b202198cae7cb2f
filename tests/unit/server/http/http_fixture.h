// A coordinator's HTTP server on loopback, with tokens of each role.
#pragma once

#include <gmock/gmock.h>

#include <map>
#include <memory>
#include <string>

#include "common/access/secrets.h"
#include "common/access/tokens.h"
#include "server/http/http_server.h"
#include "tests/support/http_client.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {

class HttpTest : public ServerTest {
 protected:
  static constexpr const char* kRoles[] = {"viewer", "submitter", "worker", "admin"};

  HttpTest() {
    for (const char* role : kRoles) AddToken(role, *ParseRole(role), 0);
    AskForTokens();
  }
  ~HttpTest() override {
    http_.reset();
    server_.reset();  // it uses access_
  }

  void AddToken(const std::string& name, Role role, int64_t expires_us) {
    tokens_[name] = RandomSecret();
    EXPECT_TRUE(table_.Add({name, role, Sha256Hex(tokens_[name]), expires_us}).ok());
    WriteTokens();
  }
  void Revoke(const std::string& name) {
    EXPECT_TRUE(table_.Remove(name));
    WriteTokens();
  }
  void WriteTokens() {
    EXPECT_TRUE(WriteSecretFile(token_file_, table_.ToText()).ok());
    if (access_ != nullptr) {
      EXPECT_TRUE(access_->Refresh().ok());
    }
  }
  void AskForTokens() {
    access_ = *Access::Open("key of workers", token_file_, &clock_);
    environment_.access = access_.get();
    StartHttp();
  }
  // With no token file: everybody may do everything.
  void AskForNothing() {
    environment_.access = nullptr;
    StartHttp();
  }
  void StartHttp() {
    http_.reset();
    RestartServer();
    options_http_.address = "127.0.0.1:0";
    options_http_.version = "1.2.3";
    auto started = HttpServer::Start(options_http_, server_.get());
    ASSERT_TRUE(started.ok()) << started.status();
    http_ = *std::move(started);
  }

  const std::string& Address() const { return http_->address(); }
  SentHeaders Bearer(const std::string& name) { return {{"Authorization", "Bearer " + tokens_[name]}, kChange}; }
  HttpReply LogIn(const std::string& token) {
    return HttpAsk(Address(), "POST", "/api/v1/session", {kChange}, "{\"token\":\"" + token + "\"}");
  }
  // The headers of a browser in which this token logged in.
  SentHeaders Session(const std::string& name) {
    const HttpReply answer = LogIn(tokens_[name]);
    EXPECT_EQ(answer.status, 200) << answer.body;
    const std::string cookie = answer.Header("set-cookie");
    return {{"Cookie", cookie.substr(0, cookie.find(';'))}, kChange};
  }
  HttpReply Ask(const std::string& method, const std::string& target, const SentHeaders& headers,
                const std::string& body = "") {
    return HttpAsk(Address(), method, target, headers, body);
  }
  // A call over gRPC.
  Status ListOverRpc(double seconds = 5) {
    grpc::ClientContext context;
    SetDeadline(context, seconds);
    context.AddMetadata("authorization", "Bearer " + tokens_["viewer"]);
    v1::ListJobsResponse response;
    const grpc::Status status = jobs_->ListJobs(&context, {}, &response);
    return Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
  }

  static inline const std::pair<std::string, std::string> kChange = {"X-Tessera", "1"};
  TokenTable table_;
  std::map<std::string, std::string> tokens_;  // by name
  std::string token_file_ = folder_.path() + "/tokens";
  std::unique_ptr<Access> access_;
  HttpOptions options_http_;
  std::unique_ptr<HttpServer> http_;
};

}  // namespace tessera
