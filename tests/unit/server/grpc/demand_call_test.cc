// Workers.GetDemand, and the allocations of registered workers.
#include <gmock/gmock.h>

#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class DemandCallTest : public ServerTest {
 protected:
  grpc::Status GetDemand(const v1::GetDemandRequest& request) {
    grpc::ClientContext context;
    response_.Clear();
    return workers_->GetDemand(&context, request, &response_);
  }
  v1::GetDemandResponse response_;
};

TEST_F(DemandCallTest, AnswersOneDemandForEachClass) {
  v1::GetDemandRequest request;
  ASSERT_TRUE(GetDemand(request).ok());
  EXPECT_EQ(response_.demands_size(), 8) << "1, 2, ... 64 GiB, and more";
  EXPECT_EQ(response_.demands(0).workers(), 0);
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  v1::WorkerClass& only = *request.add_classes();
  only.set_memory_bytes(int64_t{3} << 30);
  only.set_cores(4);
  ASSERT_TRUE(GetDemand(request).ok());
  ASSERT_EQ(response_.demands_size(), 1);
  EXPECT_EQ(response_.demands(0).memory_bytes(), int64_t{3} << 30);
  EXPECT_EQ(response_.demands(0).workers(), 1);
  EXPECT_EQ(response_.demands(0).core_s(), 1) << "of the ingest task";
  EXPECT_EQ(response_.unfit_count(), 0);
  only.set_time_limit_s(20);
  ASSERT_TRUE(GetDemand(request).ok());
  EXPECT_EQ(response_.demands(0).workers(), 0);
  ASSERT_EQ(response_.unfit_count(), 1);
  EXPECT_EQ(response_.unfit(0).task(), job.name() + "/tasks/0");
  EXPECT_EQ(response_.unfit(0).title(), "read the scene");
}

TEST_F(DemandCallTest, WrongFieldsAreRefused) {
  using Change = std::function<void(v1::GetDemandRequest&)>;
  const auto first = [](v1::GetDemandRequest& request) -> v1::WorkerClass& { return *request.mutable_classes(0); };
  const std::vector<std::pair<Change, std::string>> cases = {
      {[](auto& request) { request.set_worth_s(-1); }, "worth_s: found -1"},
      {[](auto& request) { request.set_worth_s(std::numeric_limits<double>::quiet_NaN()); }, "worth_s: found nan"},
      {[&](auto& request) { first(request).set_memory_bytes(0); }, "classes[0].memory_bytes: found 0"},
      {[&](auto& request) { first(request).set_cores(-1); }, "classes[0].cores: found -1"},
      {[&](auto& request) { first(request).set_time_limit_s(-1); }, "classes[0].time_limit_s: found -1"},
      {[](auto& request) { request.add_classes()->set_memory_bytes(1); }, "classes[1].memory_bytes: found 1"},
      {[](auto& request) {
         while (request.classes_size() < 33) request.add_classes()->set_memory_bytes(int64_t{1} << 40);
       },
       "classes: found 33, expected at most 32"}};
  for (const auto& [change, message] : cases) {
    v1::GetDemandRequest request;
    request.add_classes()->set_memory_bytes(1 << 30);
    change(request);
    const grpc::Status status = GetDemand(request);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << message;
    EXPECT_THAT(status.error_message(), HasSubstr(message));
  }
}

TEST_F(DemandCallTest, WorkersTellAllocationAndTimeLeft) {
  grpc::ClientContext registering, listing;
  v1::RegisterWorkerRequest request;
  request.set_version(kAlgorithmVersion);
  request.set_allocation("4711");
  request.set_time_left_s(100);
  v1::RegisterWorkerResponse registered;
  ASSERT_TRUE(workers_->RegisterWorker(&registering, request, &registered).ok());
  clock_.Advance(40);
  v1::ListWorkersResponse listed;
  ASSERT_TRUE(workers_->ListWorkers(&listing, {}, &listed).ok());
  ASSERT_EQ(listed.workers_size(), 1);
  EXPECT_EQ(listed.workers(0).allocation(), "4711");
  EXPECT_EQ(listed.workers(0).time_left_s(), 60);

  grpc::ClientContext refused;
  request.set_time_left_s(-1);
  EXPECT_EQ(workers_->RegisterWorker(&refused, request, &registered).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace tessera
