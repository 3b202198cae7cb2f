#include "common/rpc/status_conversion.h"

#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <string>

#include "common/rpc/retry.h"

namespace tessera {
namespace {

TEST(StatusConversionTest, EveryCodeAndMessageSurvivesTheRoundTrip) {
  for (int code = 0; code <= 16; ++code) {
    if (code == static_cast<int>(absl::StatusCode::kCancelled)) continue;
    const Status status(static_cast<absl::StatusCode>(code), code == 0 ? "" : "scene.json: line 3: found x");
    EXPECT_EQ(FromGrpc(ToGrpc(status)), status) << code;
  }
}

TEST(StatusConversionTest, ACallThatAServerBreaksOffAsItStopsMayBeRepeated) {
  const Status status = FromGrpc(ToGrpc(absl::CancelledError("")));
  EXPECT_EQ(status.code(), absl::StatusCode::kAborted);
  EXPECT_FALSE(status.message().empty());
  EXPECT_TRUE(IsTransient(status, Idempotency::kIdempotent));
  EXPECT_FALSE(IsTransient(status, Idempotency::kOnce));
}

TEST(StatusConversionTest, UnknownCodesBecomeUnknown) {
  EXPECT_EQ(FromGrpc(grpc::Status(static_cast<grpc::StatusCode>(20), "odd")).code(), absl::StatusCode::kUnknown);
}

TEST(StatusConversionTest, LongMessagesAreCutAtALineAndSaySo) {
  std::string message;
  for (int i = 0; i < 10000; ++i) message += "image " + std::to_string(i) + " is missing\n";
  const std::string cut = ToGrpc(absl::InvalidArgumentError(message)).error_message();
  EXPECT_LT(cut.size(), 100'000u);
  EXPECT_GT(cut.size(), 90'000u);
  EXPECT_NE(cut.find(" is missing\n... and "), std::string::npos);
}

TEST(StatusConversionTest, CutsBetweenCharacters) {
  std::string message = "x";
  while (message.size() < 200'000) message += "\xC3\xBC";
  const std::string cut = ToGrpc(absl::InvalidArgumentError(message)).error_message();
  const std::string kept = cut.substr(0, cut.find('\n'));
  EXPECT_EQ(kept.size() % 2, 1u);
}

}  // namespace
}  // namespace tessera
