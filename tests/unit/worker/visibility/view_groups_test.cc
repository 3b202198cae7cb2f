#include "worker/visibility/view_groups.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "common/base/random.h"

namespace tessera {
namespace {

// Compares with the definition for sparse and dense flags, several margins and map sizes.
TEST(KeepNearOwn, KeepsExactlyThePixelsWithinTheMargin) {
  Random random(7);
  int64_t kept = 0, dropped = 0;
  for (int run = 0; run < 60; ++run) {
    FaceMap map;
    map.width = 1 + static_cast<int>(random.Below(run % 3 == 0 ? 200 : 40));
    map.height = 1 + static_cast<int>(random.Below(40));
    const int margin = static_cast<int>(random.Below(run % 5 == 0 ? 80 : 8)), faces = 50;
    std::vector<uint8_t> own(faces, 0);
    for (uint8_t& flag : own) flag = random.Uniform() < 0.02 * run / 60.0;
    own[0] = 1;
    for (int i = 0; i < map.width * map.height; ++i) {
      const double kind = random.Uniform();
      map.face.push_back(kind < 0.1   ? -1
                         : kind < 0.2 ? kNotSelected
                                      : static_cast<int32_t>(1 + random.Below(faces - 1)));
      map.depth.push_back(1);
    }
    if (run % 2 == 0) map.face[random.Below(map.face.size())] = 0;
    const FaceMap before = map;
    KeepNearOwn(FaceBits(own), margin, &map);
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        bool near = false;
        for (int v = std::max(0, y - margin); v <= std::min(map.height - 1, y + margin); ++v) {
          for (int u = std::max(0, x - margin); u <= std::min(map.width - 1, x + margin); ++u) {
            const int32_t face = before.face[v * map.width + u];
            near = near || (face >= 0 && own[face] != 0);
          }
        }
        const int at = y * map.width + x;
        ASSERT_EQ(map.face[at], near ? before.face[at] : -1) << "run " << run << " at " << x << ", " << y;
        ++(near ? kept : dropped);
      }
    }
    EXPECT_EQ(map.depth, before.depth);
  }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(dropped, 1000);
}

// Neighbouring pixels show faces of one cell, whose flags are equal: whole runs are kept or dropped.
TEST(KeepNearOwn, KeepsWholeRunsOfOwnCells) {
  constexpr int kCellFaces = 150, kCellPixels = 37;
  Random random(8);
  FaceMap map;
  map.width = 400;
  map.height = 6;
  std::vector<uint8_t> own;
  for (int cell = 0; cell < 12; ++cell) own.insert(own.end(), kCellFaces, cell % 3 == 0);
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const auto face = static_cast<int32_t>(x / kCellPixels * kCellFaces + random.Below(kCellFaces));
      map.face.push_back(y == 2 && random.Uniform() < 0.1 ? -1 : face);
      map.depth.push_back(1);
    }
  }
  const FaceMap before = map;
  KeepNearOwn(FaceBits(own), 0, &map);
  for (size_t i = 0; i < map.face.size(); ++i) {
    ASSERT_EQ(map.face[i], before.face[i] >= 0 && own[before.face[i]] ? before.face[i] : -1) << i;
  }
}

TEST(FaceBits, ComparesRangesWithEachFace) {
  Random random(9);
  std::vector<uint8_t> flags(700);
  for (size_t f = 0; f < flags.size(); ++f) flags[f] = f < 200 || (f >= 400 && random.Uniform() < 0.01);
  const FaceBits bits(flags);
  std::array<int, 3> seen = {};
  for (int i = 0; i < 3000; ++i) {
    const auto first = static_cast<int32_t>(random.Below(flags.size()));
    const auto last = std::min<int32_t>(first + static_cast<int32_t>(random.Below(i % 2 == 0 ? 300 : 700)), 699);
    const auto count = std::count(flags.begin() + first, flags.begin() + last + 1, 1);
    const FaceBits::Share expected = count == 0                  ? FaceBits::Share::kNone
                                     : count == last - first + 1 ? FaceBits::Share::kAll
                                                                 : FaceBits::Share::kSome;
    ASSERT_EQ(bits.Of(first, last), expected) << first << " to " << last;
    ++seen[static_cast<size_t>(expected)];
    EXPECT_EQ(bits[first], flags[first] != 0);
  }
  for (const int times : seen) EXPECT_GT(times, 100);
}

}  // namespace
}  // namespace tessera
