#include "common/exporting/sheet.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/files.h"

namespace tessera {
namespace {

Sheet TwoFaces() {
  Sheet sheet;
  sheet.vertices = {{0, 0, 0}, {1, 0, 0.1}, {0, 1, 1.0 / 3}, {1, 1, -5}};
  sheet.faces = {{0, 1, 2}, {2, 1, 3}};
  sheet.labels = {1, -1};
  sheet.confidence = {0.5f, 0};
  sheet.displacement_m = {0, 0.1f, 0.2f, 0.3f};
  sheet.colors = {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}, {10, 11, 12}};
  sheet.shared = {0, 1, 1, 0};
  return sheet;
}

TEST(SheetTest, FindsTheSheetOfACellOnBothSidesOfZero) {
  EXPECT_EQ(SheetOf({0, 15}), (SheetId{0, 0}));
  EXPECT_EQ(SheetOf({16, -1}), (SheetId{1, -1}));
  EXPECT_EQ(SheetOf({-16, -17}), (SheetId{-1, -2}));
  for (int x = -40; x < 40; ++x) {
    EXPECT_TRUE(CellsOf(SheetOf({x, -x})).Contains({x, -x})) << x;
  }
  EXPECT_EQ(SheetName({3, -1}), "3_-1");
}

TEST(SheetTest, IsReadAsItWasWritten) {
  const TempFolder folder = *TempFolder::Create(testing::TempDir());
  const Sheet sheet = TwoFaces();
  ASSERT_TRUE(WriteSheet(folder.path() + "/a", sheet).ok());
  const StatusOr<Sheet> read = ReadSheet(folder.path() + "/a");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->vertices, sheet.vertices);
  EXPECT_EQ(read->faces, sheet.faces);
  EXPECT_EQ(read->labels, sheet.labels);
  EXPECT_EQ(read->confidence, sheet.confidence);
  EXPECT_EQ(read->displacement_m, sheet.displacement_m);
  EXPECT_EQ(read->colors, sheet.colors);
  EXPECT_EQ(read->shared, sheet.shared);
}

TEST(SheetTest, RefusesIndicesOutOfRangeAndArraysOfOtherSizes) {
  const TempFolder folder = *TempFolder::Create(testing::TempDir());
  Sheet sheet = TwoFaces();
  sheet.faces[1][2] = 4;
  ASSERT_TRUE(WriteSheet(folder.path() + "/a", sheet).ok());
  EXPECT_THAT(std::string(ReadSheet(folder.path() + "/a").status().message()),
              testing::HasSubstr("found vertex index 4, expected an index below 4"));
  sheet = TwoFaces();
  sheet.labels.pop_back();
  ASSERT_TRUE(WriteSheet(folder.path() + "/a", sheet).ok());
  EXPECT_EQ(ReadSheet(folder.path() + "/a").status().code(), absl::StatusCode::kDataLoss);
  sheet = TwoFaces();
  sheet.shared.pop_back();
  ASSERT_TRUE(WriteSheet(folder.path() + "/a", sheet).ok());
  EXPECT_EQ(ReadSheet(folder.path() + "/a").status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
