#include "common/arrays/array_file.h"

#include <gtest/gtest.h>

#include "common/storage/files.h"

namespace tessera {
namespace {

ArrayFile MakeFile() {
  ArrayFile file;
  file.metadata = R"({"tile":3})";
  file.arrays["floats"] = std::vector<float>{1.5f, -2.25f};
  file.arrays["doubles"] = std::vector<double>{0.1, 1e300, -0.0};
  file.arrays["labels"] = std::vector<int32_t>{-1, 7};
  file.arrays["ids"] = std::vector<uint32_t>{0, 4000000000u};
  file.arrays["wide"] = std::vector<int64_t>{int64_t{1} << 40};
  file.arrays["flags"] = std::vector<uint8_t>{1, 0, 255};
  file.arrays["none"] = std::vector<double>{};
  return file;
}

TEST(ArrayFile, RoundTrip) {
  const std::string path = testing::TempDir() + "/array_file_test.arrays";
  ASSERT_TRUE(WriteArrayFile(path, MakeFile()).ok());
  const StatusOr<ArrayFile> read = ReadArrayFile(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->metadata, MakeFile().metadata);
  EXPECT_EQ(read->arrays, MakeFile().arrays);
}

TEST(ArrayFile, EqualContentsSerializeToEqualBytes) {
  EXPECT_EQ(SerializeArrayFile(MakeFile()), SerializeArrayFile(MakeFile()));
}

TEST(ArrayFile, DetectsEveryChangedByte) {
  const std::string bytes = SerializeArrayFile(MakeFile());
  for (size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] ^= 0x10;
    const StatusOr<ArrayFile> read = ParseArrayFile(damaged, "damaged");
    EXPECT_EQ(read.status().code(), absl::StatusCode::kDataLoss) << "byte " << i;
    EXPECT_NE(std::string(read.status().message()).find("damaged: byte "), std::string::npos) << "byte " << i;
  }
}

TEST(ArrayFile, DetectsTruncationAndExtraBytes) {
  const std::string bytes = SerializeArrayFile(MakeFile());
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(ParseArrayFile(bytes.substr(0, size), "cut").ok()) << size;
  }
  EXPECT_FALSE(ParseArrayFile(bytes + '\0', "long").ok());
}

TEST(ArrayFile, TakeChecksNameTypeAndCount) {
  ArrayFile file = MakeFile();
  EXPECT_FALSE(file.Take<float>("nothing").ok());
  EXPECT_FALSE(file.Take<double>("floats").ok());
  EXPECT_FALSE(file.Take<float>("floats", 3).ok());
  const StatusOr<std::vector<float>> taken = file.Take<float>("floats", 2);
  ASSERT_TRUE(taken.ok());
  EXPECT_EQ(*taken, (std::vector<float>{1.5f, -2.25f}));
  EXPECT_FALSE(file.Take<float>("floats").ok()) << "it was moved out";
}

TEST(ArrayFile, RejectsLongArrayNames) {
  ArrayFile file;
  file.arrays[std::string(255, 'a')] = std::vector<double>{1};
  EXPECT_TRUE(ParseArrayFile(SerializeArrayFile(file), "short").ok());
  file.arrays[std::string(256, 'b')] = std::vector<double>{1};
  const Status refused = ParseArrayFile(SerializeArrayFile(file), "long").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kDataLoss);
  EXPECT_LT(refused.message().size(), 100u) << refused;
}

TEST(ArrayFile, MissingFileIsNotFound) {
  EXPECT_EQ(ReadArrayFile(testing::TempDir() + "/no_such.arrays").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
