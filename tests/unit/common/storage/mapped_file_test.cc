#include "common/storage/mapped_file.h"

#include <gtest/gtest.h>

#include "common/storage/files.h"

namespace tessera {
namespace {

TEST(MappedFile, MapsTheFileAndNamesAMissingOne) {
  const std::string path = testing::TempDir() + "/mapped_file_test";
  ASSERT_TRUE(WriteFileAtomic(path, "seven b").ok());
  const auto file = MappedFile::Open(path);
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(std::string(file->data(), file->size_bytes()), "seven b");
  ASSERT_TRUE(WriteFileAtomic(path, "").ok());
  EXPECT_EQ(MappedFile::Open(path)->size_bytes(), 0u);
  EXPECT_EQ(MappedFile::Open(path + "-not").status().code(), absl::StatusCode::kNotFound);
}

TEST(Scratch, KeepsValuesAndIsDeleted) {
  const auto folder = TempFolder::Create(testing::TempDir());
  ASSERT_TRUE(folder.ok());
  auto array = ScratchArray<uint64_t>::Create(folder->path(), 100000);
  ASSERT_TRUE(array.ok()) << array.status();
  auto list = ScratchList<uint64_t>::Create(folder->path());
  ASSERT_TRUE(list.ok());
  for (uint64_t i = 0; i < array->size(); ++i) {
    EXPECT_EQ((*array)[i], 0u);
    (*array)[i] = i * i;
    list->Append(i * i);
  }
  EXPECT_EQ(list->size(), array->size());
  auto listed = list->Finish();
  ASSERT_TRUE(listed.ok()) << listed.status();
  for (uint64_t i = 0; i < array->size(); ++i) {
    ASSERT_EQ((*array)[i], i * i);
    ASSERT_EQ((*listed)[i], i * i);
  }
  const ScratchArray<uint64_t> moved = *std::move(array);
  EXPECT_EQ(moved[3], 9u);
  EXPECT_TRUE(ListFiles(folder->path())->empty());
}

TEST(Scratch, MoreThanTheFreeDiskSpaceIsResourceExhausted) {
  const auto array = ScratchArray<uint8_t>::Create(testing::TempDir(), size_t{1} << 55);
  EXPECT_FALSE(array.ok());
}

}  // namespace
}  // namespace tessera
