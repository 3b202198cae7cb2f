#include "common/rpc/channel.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>

#include "common/access/certificates.h"
#include "common/access/secrets.h"
#include "tessera/v1/blobs.grpc.pb.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Answers StatBlobs with its name.
class NamedServer final : public v1::Blobs::Service {
 public:
  explicit NamedServer(std::string name, const std::string& host = "127.0.0.1", int port = 0,
                       std::shared_ptr<grpc::ServerCredentials> credentials = grpc::InsecureServerCredentials())
      : name_(std::move(name)) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort(host + ":" + std::to_string(port), credentials, &port_);
    builder.RegisterService(this);
    AllowKeepalive(builder);
    server_ = builder.BuildAndStart();
  }
  ~NamedServer() override {
    if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
  }
  int port() const { return port_; }
  grpc::Status StatBlobs(grpc::ServerContext*, const v1::StatBlobsRequest*, v1::StatBlobsResponse*) override {
    return {grpc::StatusCode::OUT_OF_RANGE, name_};
  }

 private:
  const std::string name_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

// The name of the server that answers, or why none does. If `wait`, waits for a connection, and calls again where the
// connection ended during the call.
std::string AnsweredBy(const std::shared_ptr<grpc::Channel>& channel, bool wait = true) {
  const auto call = [&] {
    grpc::ClientContext context;
    SetDeadline(context, 20);
    context.set_wait_for_ready(wait);
    v1::StatBlobsResponse response;
    return v1::Blobs::NewStub(channel)->StatBlobs(&context, v1::StatBlobsRequest(), &response);
  };
  grpc::Status status = call();
  for (int again = 0; wait && again < 100 && status.error_code() == grpc::StatusCode::UNAVAILABLE; ++again) {
    status = call();
  }
  return status.error_message();
}

int FreePort() { return NamedServer("for its port").port(); }

std::string Local(int port) { return "127.0.0.1:" + std::to_string(port); }

TEST(ChannelTest, ListUsesWhicheverCoordinatorListens) {
  auto second = std::make_unique<NamedServer>("second");
  const int first_port = FreePort();
  const auto channel = *OpenChannel(Local(first_port) + ",localhost:" + std::to_string(second->port()), nullptr);
  EXPECT_EQ(AnsweredBy(channel), "second");
  const int second_port = second->port();
  second = nullptr;
  auto first = std::make_unique<NamedServer>("first", "127.0.0.1", first_port);
  EXPECT_EQ(AnsweredBy(channel), "first");
  first = nullptr;
  second = std::make_unique<NamedServer>("second again", "127.0.0.1", second_port);
  EXPECT_EQ(AnsweredBy(channel), "second again");
}

TEST(ChannelTest, ListMixesFamiliesOfAddresses) {
  const NamedServer sixth("sixth", "[::1]");
  if (sixth.port() == 0) GTEST_SKIP() << "no IPv6 here";
  EXPECT_EQ(AnsweredBy(*OpenChannel("[::1]:" + std::to_string(sixth.port()) + "," + Local(FreePort()), nullptr)),
            "sixth");
  const NamedServer fourth("fourth");
  EXPECT_EQ(AnsweredBy(*OpenChannel("[::1]:" + std::to_string(FreePort()) + "," + Local(fourth.port()), nullptr)),
            "fourth");
}

TEST(ChannelTest, MissingAuthoritiesOfTheStoreAreTold) {
  Endpoint endpoint("127.0.0.1:1");
  endpoint.store_ca = "/nowhere/ca.pem";
  const Status status = OpenChannel(endpoint, nullptr).status();
  EXPECT_NE(status.message().find("--s3-ca (AWS_CA_BUNDLE): "), std::string::npos) << status;
}

TEST(ChannelTest, CertificatesOfAListNameItsFirstHost) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const int64_t now_s =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  const Certificate authority = *MakeAuthority({"ours", {}, now_s, -3600, 86400});
  Endpoint endpoint;
  endpoint.tls_ca = folder.path() + "/ca.pem";
  ASSERT_TRUE(WriteSecretFile(endpoint.tls_ca, authority.certificate_pem).ok());
  const auto credentials = [&](const std::vector<std::string>& hosts) {
    const Certificate made = *MakeCertificate(authority, {"server", hosts, now_s, -3600, 86400});
    grpc::SslServerCredentialsOptions tls;
    tls.pem_key_cert_pairs.push_back({made.key_pem, made.certificate_pem});
    return grpc::SslServerCredentials(tls);
  };
  const NamedServer both("names both", "127.0.0.1", 0, credentials({"localhost", "127.0.0.1"})),
      first("names the first", "127.0.0.1", 0, credentials({"localhost"})),
      other("names neither", "127.0.0.1", 0, credentials({"other"}));
  const int closed = FreePort();
  const auto asked = [&](const std::string& list) {
    endpoint.address = list;
    return AnsweredBy(*OpenChannel(endpoint, nullptr), /*wait=*/false);
  };
  const std::string localhost = "localhost:" + std::to_string(closed) + ",";
  EXPECT_EQ(asked(localhost + Local(both.port())), "names both");
  EXPECT_EQ(asked(Local(closed) + ",localhost:" + std::to_string(both.port())), "names both");
  EXPECT_EQ(asked(localhost + Local(first.port())), "names the first");
  EXPECT_THAT(asked(Local(closed) + ",localhost:" + std::to_string(first.port())), HasSubstr("failed to connect"));
  EXPECT_THAT(asked(localhost + Local(other.port())), HasSubstr("failed to connect"));
}

TEST(ChannelTest, ListsThatCannotWorkAreRefusedInWords) {
  const auto refusal = [](const std::string& address) {
    return std::string(OpenChannel(address, nullptr).status().message());
  };
  for (const char* mixed : {"unix:/tmp/socket,city:7575", "city:7575,unix:/tmp/socket", "unix:/a,unix:/b"}) {
    EXPECT_THAT(refusal(mixed), HasSubstr("a list has no unix:PATH")) << mixed;
  }
  EXPECT_THAT(refusal("a:7575,"), HasSubstr("found '' in the list"));
  EXPECT_THAT(refusal("a:7575,b"), HasSubstr("found 'b' in the list"));
  EXPECT_THAT(refusal("127.0.0.1:1,host.invalid:7575"),
              HasSubstr("cannot find the host of the coordinator host.inval"));
  EXPECT_TRUE(CheckEndpointAddress("unix:/tmp/a,b").ok()) << "a path with a comma";
  EXPECT_FALSE(CheckAddress("a:7575,b:7575").ok()) << "an address to listen on";
  Endpoint far("127.0.0.1:7575,city:7575");
  far.token_file = "token";
  EXPECT_THAT(std::string(OpenChannel(far, nullptr).status().message()), HasSubstr("--tls-ca"));
}

}  // namespace
}  // namespace tessera
