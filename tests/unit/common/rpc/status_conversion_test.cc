#include "common/rpc/status_conversion.h"

#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <string>

#include "common/base/refusal.h"
#include "common/base/retry/retry.h"

namespace tessera {
namespace {

TEST(StatusConversionTest, CodesAndMessagesRoundTrip) {
  for (int code = 0; code <= 16; ++code) {
    if (code == static_cast<int>(absl::StatusCode::kCancelled)) continue;
    const Status status(static_cast<absl::StatusCode>(code), code == 0 ? "" : "scene.json: line 3: found x");
    EXPECT_EQ(FromGrpc(ToGrpc(status)), status) << code;
  }
}

TEST(StatusConversionTest, CancelledByServerBecomesRetryableAborted) {
  const Status status = FromGrpc(ToGrpc(absl::CancelledError("")));
  EXPECT_EQ(status.code(), absl::StatusCode::kAborted);
  EXPECT_FALSE(status.message().empty());
  EXPECT_TRUE(IsTransient(status, Idempotency::kIdempotent));
  EXPECT_FALSE(IsTransient(status, Idempotency::kOnce));
}

TEST(StatusConversionTest, FaultsLimitsAndRetryDelaysRoundTrip) {
  Faults faults;
  faults.Add(InputError("mesh.ply", "line 12", "'x'", "a number"));
  faults.Add(absl::NotFoundError("something else"));
  faults.Add(InputError("settings.tiles", "", "-1", "at least 0"));
  const Status told = FromGrpc(ToGrpc(faults.ToStatus()));
  EXPECT_EQ(told.message(), faults.ToStatus().message());
  const std::vector<InputFault> parts = FaultsOf(told);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].file, "mesh.ply");
  EXPECT_EQ(parts[0].location, "line 12");
  EXPECT_EQ(parts[0].found, "'x'");
  EXPECT_EQ(parts[0].expected, "a number");
  EXPECT_EQ(parts[1].file, "settings.tiles");

  const Status limit =
      FromGrpc(ToGrpc(RetryAfter(LimitError({"watches of 'anna'", 7, "--max-watches"}, "end some"), 2.5)));
  EXPECT_EQ(limit.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(limit.message(), "watches of 'anna': limit 7 reached (tesserad --max-watches); end some");
  EXPECT_EQ(RefusalOf(limit), Refusal::kLimit);
  EXPECT_EQ(LimitOf(limit).what, "watches of 'anna'");
  EXPECT_EQ(LimitOf(limit).most, 7);
  EXPECT_EQ(LimitOf(limit).flag, "--max-watches");
  EXPECT_EQ(RetryDelayOf(limit), 2.5);
  EXPECT_EQ(RetryDelayOf(absl::UnavailableError("")), 0);
  EXPECT_TRUE(LimitOf(absl::UnavailableError("")).what.empty());
}

TEST(StatusConversionTest, DetailsAreBounded) {
  Faults faults;
  for (int i = 0; i < 1000; ++i) {
    faults.Add(
        InputError("image " + std::to_string(i), "", std::string(10'000, i % 2 == 0 ? '\xff' : 'x'), "a number"));
  }
  const grpc::Status told = ToGrpc(faults.ToStatus());
  EXPECT_LE(told.error_details().size(), 4096u);
  const std::vector<InputFault> parts = FaultsOf(FromGrpc(told));
  ASSERT_GE(parts.size(), 2u);
  EXPECT_EQ(parts[1].file, "image 1");
}

TEST(StatusConversionTest, UnknownCodesBecomeUnknown) {
  EXPECT_EQ(FromGrpc(grpc::Status(static_cast<grpc::StatusCode>(20), "odd")).code(), absl::StatusCode::kUnknown);
}

TEST(StatusConversionTest, LongMessagesAreCutAtALineEnd) {
  std::string message;
  for (int i = 0; i < 10000; ++i) message += "image " + std::to_string(i) + " is missing\n";
  const std::string cut = ToGrpc(absl::InvalidArgumentError(message)).error_message();
  EXPECT_LT(cut.size(), 100'000u);
  EXPECT_GT(cut.size(), 90'000u);
  EXPECT_NE(cut.find(" is missing\n... and "), std::string::npos);
}

TEST(StatusConversionTest, CutsAtCharacterBoundaries) {
  std::string message = "x";
  while (message.size() < 200'000) message += "\xC3\xBC";
  const std::string cut = ToGrpc(absl::InvalidArgumentError(message)).error_message();
  const std::string kept = cut.substr(0, cut.find('\n'));
  EXPECT_EQ(kept.size() % 2, 1u);
}

}  // namespace
}  // namespace tessera
