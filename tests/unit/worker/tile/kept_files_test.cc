#include "worker/tile/kept/kept_files.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace tessera {
namespace {

std::string KeptPath(const std::string& name) { return testing::TempDir() + "/kept_" + name; }

std::string WriteSums(const std::string& name, int tile, float pairs) {
  TileSums sums;
  sums.tile = tile;
  sums.face_ids = {7};
  sums.photo.resize(1);
  sums.photo[0].pairs = pairs;
  EXPECT_TRUE(WriteTileSums(KeptPath(name), sums).ok());
  return KeptPath(name);
}

float PairsIn(const std::string& path) {
  const auto sums = OpenSums(path);
  return sums.ok() ? (*sums)->photo[0].pairs : -1;
}

TEST(KeptFiles, ReadsAContentOnceHoweverItIsNamed) {
  const std::string path = WriteSums("sums_a", 3, 2.5f), link = KeptPath("sums_link");
  std::filesystem::remove(link);
  std::filesystem::create_hard_link(path, link);
  const auto first = OpenSums(path), second = OpenSums(link);
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(first->get(), second->get());
  EXPECT_EQ((*first)->photo[0].pairs, 2.5f);

  TileState state;
  state.tile = 3;
  state.vertex_ids = {1};
  state.positions = {{1, 2, 3}};
  ASSERT_TRUE(WriteTileState(KeptPath("state"), state).ok());
  const auto mapped = OpenState(KeptPath("state")), again = OpenState(KeptPath("state"));
  ASSERT_TRUE(mapped.ok() && again.ok());
  EXPECT_EQ(mapped->get(), again->get());
  EXPECT_EQ((*mapped)->spans().positions[0], Eigen::Vector3d(1, 2, 3));
}

TEST(KeptFiles, AnotherContentIsReadAnew) {
  EXPECT_EQ(PairsIn(WriteSums("sums_b", 4, 1)), 1);
  EXPECT_EQ(PairsIn(WriteSums("sums_b", 4, 2)), 2) << "of the same path";
}

TEST(KeptFiles, OneContentOfATileIsKept) {
  const std::string step1 = WriteSums("sums_1", 5, 1), step2 = WriteSums("sums_2", 5, 2);
  const auto held = OpenSums(step1);
  ASSERT_TRUE(held.ok());
  EXPECT_EQ(PairsIn(step2), 2);
  const auto again = OpenSums(step1);
  ASSERT_TRUE(again.ok());
  EXPECT_NE(held->get(), again->get());
  EXPECT_EQ((*held)->photo[0].pairs, 1) << "a task that holds it may go on";
}

TEST(KeptFiles, DamageIsFound) {
  const std::string path = WriteSums("sums_damaged", 6, 1);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(-1, std::ios::end).put('\x55');
  file.close();
  EXPECT_EQ(OpenSums(path).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(OpenSums(path).status().code(), absl::StatusCode::kDataLoss) << "the failure is not kept as a content";
  EXPECT_EQ(OpenState(KeptPath("none")).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
