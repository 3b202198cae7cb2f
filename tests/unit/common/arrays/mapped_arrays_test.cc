#include "common/arrays/mapped_arrays.h"

#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <thread>

#include "common/storage/files.h"

namespace tessera {
namespace {

std::string TestPath(const std::string& name) { return testing::TempDir() + "/" + name; }

TEST(ArrayFileWriter, WritesTheSameBytesInAnyAppendOrder) {
  ArrayFile file;
  file.metadata = R"({"a":1})";
  std::vector<uint32_t> ids(300000);
  std::iota(ids.begin(), ids.end(), 7u);
  file.arrays["ids"] = ids;
  file.arrays["points"] = std::vector<double>{0.5, -0.0, 1e300};
  file.arrays["none"] = std::vector<uint8_t>{};
  ASSERT_TRUE(WriteArrayFile(TestPath("whole.arrays"), file).ok());

  auto writer = ArrayFileWriter::Create(TestPath("parts.arrays"), file.metadata,
                                        {{"points", std::vector<double>(), 3},
                                         {"none", std::vector<uint8_t>(), 0},
                                         {"ids", std::vector<uint32_t>(), ids.size()}});
  ASSERT_TRUE(writer.ok()) << writer.status();
  const std::vector<double> points = {0.5, -0.0, 1e300};
  const std::span<const uint32_t> all = ids;
  (*writer)->Append<uint32_t>("ids", all.first(3));
  (*writer)->Append<double>("points", std::span(points).first(2));
  (*writer)->Append<uint32_t>("ids", all.subspan(3, 200000));
  (*writer)->Append<uint32_t>("ids", all.subspan(200003));
  (*writer)->Append<double>("points", std::span(points).subspan(2));
  ASSERT_TRUE((*writer)->Finish().ok());
  EXPECT_EQ(*ReadFile(TestPath("parts.arrays")), *ReadFile(TestPath("whole.arrays")));
}

TEST(ArrayFileWriter, WritesTheSameBytesFromSeveralThreads) {
  constexpr size_t kArrays = 24, kThreads = 4;
  ArrayFile file;
  std::vector<ArrayFileWriter::Array> announced;
  std::vector<std::vector<uint32_t>> values(kArrays);
  for (size_t a = 0; a < kArrays; ++a) {
    values[a].resize(10000 * (a % 5) + 7);
    std::iota(values[a].begin(), values[a].end(), static_cast<uint32_t>(a));
    file.arrays[std::to_string(a)] = values[a];
    announced.push_back({std::to_string(a), std::vector<uint32_t>(), values[a].size()});
  }
  ASSERT_TRUE(WriteArrayFile(TestPath("whole.arrays"), file).ok());
  auto writer = ArrayFileWriter::Create(TestPath("threads.arrays"), file.metadata, announced);
  ASSERT_TRUE(writer.ok()) << writer.status();
  std::vector<std::thread> threads;
  for (size_t t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      for (size_t a = t; a < kArrays; a += kThreads) {
        const std::span<const uint32_t> all = values[a];
        (*writer)->Append<uint32_t>(std::to_string(a), all.first(7));
        (*writer)->Append<uint32_t>(std::to_string(a), all.subspan(7));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  ASSERT_TRUE((*writer)->Finish().ok());
  EXPECT_EQ(*ReadFile(TestPath("threads.arrays")), *ReadFile(TestPath("whole.arrays")));
}

TEST(ArrayFileWriter, RejectsCountsThatDifferFromAnnounced) {
  for (const int extra : {-1, 1}) {
    auto writer = ArrayFileWriter::Create(TestPath("count.arrays"), "{}", {{"ids", std::vector<uint32_t>(), 3}});
    ASSERT_TRUE(writer.ok());
    const std::vector<uint32_t> ids(3 + extra);
    (*writer)->Append<uint32_t>("ids", ids);
    EXPECT_EQ((*writer)->Finish().code(), absl::StatusCode::kInternal);
  }
  EXPECT_FALSE(FileExists(TestPath("count.arrays")));
}

TEST(MappedArrays, ReturnsValuesAndDetectsDamage) {
  ArrayFile file;
  file.arrays["ids"] = std::vector<uint32_t>{1, 2, 3};
  const std::string path = TestPath("mapped.arrays");
  ASSERT_TRUE(WriteArrayFile(path, file).ok());
  const auto mapped = MappedArrays::Open(path);
  ASSERT_TRUE(mapped.ok()) << mapped.status();
  const auto ids = mapped->Verified<uint32_t>("ids", 3);
  ASSERT_TRUE(ids.ok()) << ids.status();
  EXPECT_EQ((*ids)[2], 3u);
  EXPECT_EQ(mapped->Get<int32_t>("ids").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(mapped->Get<uint32_t>("ids", 2).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(mapped->Get<uint32_t>("nothing").status().code(), absl::StatusCode::kDataLoss);

  std::string bytes = SerializeArrayFile(file);
  bytes.back() ^= 1;
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  const auto damaged = MappedArrays::Open(path);
  ASSERT_TRUE(damaged.ok());
  EXPECT_EQ(damaged->Verified<uint32_t>("ids").status().code(), absl::StatusCode::kDataLoss);
  ASSERT_TRUE(WriteFileAtomic(path, bytes.substr(0, bytes.size() - 1)).ok());
  EXPECT_EQ(MappedArrays::Open(path).status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
