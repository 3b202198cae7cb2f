// Which addresses a coordinator may listen on, and where clients send their tokens.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/un.h>

#include <string>

#include "common/rpc/channel.h"
#include "server/grpc/coordinator_server.h"

namespace tessera {
namespace {

using testing::HasSubstr;

TEST(ListenOptionsTest, InsecureNetworkListenersAreRefused) {
  ListenOptions options;
  options.addresses = {"0.0.0.0:0"};
  EXPECT_THAT(std::string(CheckListenOptions(options, false).message()), HasSubstr("--insecure"));
  EXPECT_THAT(std::string(CheckListenOptions(options, true).message()), HasSubstr("--tls-cert"));
  options.insecure = true;
  EXPECT_TRUE(CheckListenOptions(options, false).ok());
  EXPECT_FALSE(CheckListenOptions(options, true).ok()) << "tokens without TLS";
  options.insecure = false;
  options.tls_cert = options.tls_key = "file";
  EXPECT_TRUE(CheckListenOptions(options, true).ok());
  EXPECT_FALSE(CheckListenOptions(options, false).ok());
  options.metrics = "0.0.0.0:9464";
  EXPECT_THAT(std::string(CheckListenOptions(options, true).message()), HasSubstr("--open-metrics"));
  options.open_metrics = true;
  EXPECT_TRUE(CheckListenOptions(options, true).ok());
  options.metrics = "127.0.0.1:9464";
  options.open_metrics = false;
  EXPECT_TRUE(CheckListenOptions(options, true).ok());
  for (const char* local : {"unix:/tmp/s", "127.0.0.1:0", "localhost:0", "[::1]:0"}) {
    EXPECT_TRUE(IsLocalAddress(local)) << local;
  }
  for (const char* far : {"127.evil.example:1", "10.0.0.1:1", "city-server:1", "[::]:1", "127.0.0.1.evil.example:1"}) {
    EXPECT_FALSE(IsLocalAddress(far)) << far;
    Endpoint endpoint(far);
    endpoint.token_file = "token";
    EXPECT_THAT(std::string(OpenChannel(endpoint, nullptr).status().message()), HasSubstr("--tls-ca")) << far;
  }
  EXPECT_FALSE(CheckAddress("unix:" + std::string(120, '/')).ok());
  EXPECT_TRUE(CheckAddress("unix:/" + std::string(sizeof(sockaddr_un::sun_path) - 2, 'x')).ok());
}

TEST(ListenOptionsTest, ThePageHasTheRulesOfOtherAddresses) {
  ListenOptions options;
  options.addresses = {"127.0.0.1:0"};
  options.http = "127.0.0.1:8080";
  EXPECT_TRUE(CheckListenOptions(options, false).ok());
  EXPECT_TRUE(CheckListenOptions(options, true).ok());
  options.http = "0.0.0.0:8080";
  EXPECT_THAT(std::string(CheckListenOptions(options, false).message()), HasSubstr("--http 0.0.0.0:8080"));
  EXPECT_THAT(std::string(CheckListenOptions(options, true).message()), HasSubstr("--tls-cert"));
  options.tls_cert = options.tls_key = "file";
  EXPECT_TRUE(CheckListenOptions(options, true).ok());
  options.insecure = true;
  EXPECT_TRUE(CheckListenOptions(options, false).ok());
  for (const char* const wrong : {"unix:/tmp/socket", "8080", "localhost", ":8080", "localhost:port"}) {
    options.http = wrong;
    EXPECT_FALSE(CheckListenOptions(options, true).ok()) << wrong;
  }
}

}  // namespace
}  // namespace tessera
