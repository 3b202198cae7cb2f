// Certificates that are renewed while a coordinator and its callers run.
#include "common/access/certificates.h"

#include <gmock/gmock.h>

#include <chrono>
#include <thread>

#include "common/access/secrets.h"
#include "tests/unit/server/grpc/raw_call.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class CertificatesTest : public ServerTest {
 protected:
  CertificatesTest() {
    Write("ca.pem", ours_.certificate_pem);
    Write("caller-ca.pem", ours_.certificate_pem);
    WritePair("server", Server(ours_));
    WritePair("caller", Caller(ours_));
  }
  static Certificate Authority() { return *MakeAuthority({"the house", {}, Now_s(), -3600, 86400}); }
  static Certificate Server(const Certificate& authority) {
    return *MakeCertificate(authority, {"server", {"127.0.0.1"}, Now_s(), -3600, 86400});
  }
  static Certificate Caller(const Certificate& authority) {
    return *MakeCertificate(authority, {"caller", {}, Now_s(), -3600, 86400});
  }
  static int64_t Now_s() { return SystemClock().UnixTimeUs() / 1'000'000; }
  std::string File(const std::string& name) const { return folder_.path() + "/" + name; }
  void Write(const std::string& name, const std::string& content) const {
    EXPECT_TRUE(WriteSecretFile(File(name), content).ok());
  }
  void WritePair(const std::string& stem, const Certificate& made) const {
    Write(stem + ".pem", made.certificate_pem);
    Write(stem + ".key", made.key_pem);
  }
  ListenOptions Tls(const std::string& address = "127.0.0.1:0") const {
    ListenOptions options;
    options.addresses = {address};
    options.tls_cert = File("server.pem");
    options.tls_key = File("server.key");
    options.tls_ca = File("ca.pem");
    return options;
  }
  void Serve(const std::string& address = "127.0.0.1:0") {
    server_->Shutdown(0);
    Restart();
    environment_.coordinator = coordinator_.get();
    auto started = CoordinatorServer::Start(Tls(address), environment_);
    ASSERT_TRUE(started.ok()) << started.status();
    server_ = *std::move(started);
  }
  // A new connection of a caller with these files.
  std::shared_ptr<grpc::Channel> Open(const std::string& trusted = "caller-ca.pem",
                                      const std::string& own = "caller") const {
    Endpoint endpoint(server_->address());
    endpoint.tls_ca = File(trusted);
    endpoint.tls_cert = File(own + ".pem");
    endpoint.tls_key = File(own + ".key");
    return *OpenChannel(endpoint, nullptr);
  }
  // The certificate of the server that answers on this channel; empty: none does.
  static std::string AnsweredWith(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    SetDeadline(context, 20);
    v1::ListJobsResponse response;
    if (!v1::Jobs::NewStub(channel)->ListJobs(&context, v1::ListJobsRequest(), &response).ok()) return "";
    const auto found = context.auth_context()->FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME);
    return found.empty() ? "none" : std::string(found.front().data(), found.front().size());
  }
  static bool WaitFor(const std::function<bool()>& condition) {
    for (int tries = 0; tries < 600; ++tries) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
  }

  const Certificate ours_ = Authority();
};

TEST_F(CertificatesTest, RenewedPairHoldsForNewConnectionsOnceItIsComplete) {
  Serve();
  const auto before = Open();
  const std::string first = AnsweredWith(before);
  ASSERT_THAT(first, HasSubstr("BEGIN CERTIFICATE"));

  const Certificate renewed = Server(ours_);
  Write("server.pem", renewed.certificate_pem);  // the key is still the earlier one
  const Certificate second_authority = Authority();
  WritePair("other", Caller(second_authority));
  EXPECT_EQ(AnsweredWith(Open("caller-ca.pem", "other")), "") << "the server does not trust it yet";
  Write("ca.pem", ours_.certificate_pem + second_authority.certificate_pem);
  ASSERT_TRUE(WaitFor([&] { return AnsweredWith(Open("caller-ca.pem", "other")) != ""; }));
  // The coordinator has read all files since the certificate was replaced.
  EXPECT_EQ(AnsweredWith(Open()), first) << "the pair is not complete";

  Write("server.key", renewed.key_pem);
  ASSERT_TRUE(WaitFor([&] { return AnsweredWith(Open()) != first; }));
  EXPECT_EQ(AnsweredWith(Open()), renewed.certificate_pem);
  EXPECT_EQ(AnsweredWith(before), first) << "the connection goes on";

  Write("server.key", renewed.key_pem.substr(0, 80));
  Write("ca.pem", ours_.certificate_pem);
  ASSERT_TRUE(WaitFor([&] { return AnsweredWith(Open("caller-ca.pem", "other")) == ""; }));
  EXPECT_EQ(AnsweredWith(Open()), renewed.certificate_pem) << "the key is cut";
  EXPECT_EQ(AnsweredWith(before), first);
}

TEST_F(CertificatesTest, ChannelReconnectsWithTheCertificatesOfANewAuthority) {
  Serve();
  const std::string address = server_->address();
  const auto channel = Open();
  ASSERT_NE(AnsweredWith(channel), "");
  const Certificate authority = Authority();
  const Certificate renewed = Server(authority);
  WritePair("server", renewed);
  Write("ca.pem", authority.certificate_pem);
  Serve(address);
  EXPECT_EQ(AnsweredWith(channel), "") << "neither side trusts the other";
  Write("caller-ca.pem", authority.certificate_pem);
  WritePair("caller", Caller(authority));
  EXPECT_TRUE(WaitFor([&] { return AnsweredWith(channel) == renewed.certificate_pem; }));
}

TEST_F(CertificatesTest, IncompleteFilesAreRefusedAtStartWithFileAndReason) {
  const Certificate made = Server(ours_), other = Server(ours_);
  const auto refusal = [&] {
    const Status status = CoordinatorServer::Start(Tls(), environment_).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
    return std::string(status.message());
  };
  Write("server.key", other.key_pem);
  EXPECT_EQ(refusal(),
            File("server.key") + ": found another key, expected the key of the certificate in " + File("server.pem"));
  WritePair("server", made);
  Write("server.key", made.key_pem.substr(0, 80));
  EXPECT_THAT(refusal(), testing::StartsWith(File("server.key") + ": found no complete private key, expected"));
  WritePair("server", made);
  Write("server.pem", made.certificate_pem + ours_.certificate_pem.substr(0, 100));
  EXPECT_THAT(refusal(), testing::StartsWith(File("server.pem") + ": certificate 2: found no complete certificate"));
  Write("server.pem", "");
  EXPECT_THAT(refusal(), testing::StartsWith(File("server.pem") + ": certificate 1: found an empty file"));
  WritePair("server", made);
  Write("ca.pem", "text");
  EXPECT_THAT(refusal(), testing::StartsWith(File("ca.pem") + ": certificate 1: found no complete certificate"));
  ASSERT_TRUE(RemoveTree(File("ca.pem")).ok());
  const Status missing = CoordinatorServer::Start(Tls(), environment_).status();
  EXPECT_THAT(std::string(missing.message()), HasSubstr(File("ca.pem")));
  Endpoint endpoint("127.0.0.1:1");
  endpoint.tls_ca = File("caller.key");
  EXPECT_THAT(std::string(OpenChannel(endpoint, nullptr).status().message()),
              testing::StartsWith(endpoint.tls_ca + ": certificate 1: found no complete certificate"));
}

}  // namespace
}  // namespace tessera
