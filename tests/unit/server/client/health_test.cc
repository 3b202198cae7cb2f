#include "server/client/health.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>

#include "tessera/v1/blobs.grpc.pb.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Any server; gRPC adds the health service to it.
class HealthTest : public testing::Test {
 protected:
  void Start(bool with_health) {
    grpc::EnableDefaultHealthCheckService(with_health);
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&service_);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }

  v1::Blobs::Service service_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

TEST_F(HealthTest, TellsWhetherTheServerServes) {
  Start(true);
  EXPECT_TRUE(CheckHealth(address_, 20).ok());
  server_->GetHealthCheckService()->SetServingStatus(false);
  const Status stopping = CheckHealth(address_, 20);
  EXPECT_EQ(stopping.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(stopping.message()), HasSubstr(address_ + " does not serve"));
  server_->GetHealthCheckService()->SetServingStatus(true);
  EXPECT_TRUE(CheckHealth(address_, 20).ok());
  server_->Shutdown(std::chrono::system_clock::now());
  const Status nobody = CheckHealth(address_, 0.1);
  EXPECT_EQ(nobody.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(nobody.message()), HasSubstr("no coordinator answers"));
}

TEST_F(HealthTest, ServerWithoutHealthServiceIsAnError) {
  Start(false);
  EXPECT_EQ(CheckHealth(address_, 20).code(), absl::StatusCode::kUnimplemented);
}

}  // namespace
}  // namespace tessera
