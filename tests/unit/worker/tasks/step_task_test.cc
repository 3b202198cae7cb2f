#include "worker/tasks/step_task.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

namespace tessera {
namespace {

// Tile 3 also measured faces 9 and 12 of tile 4.
struct Sampled {
  TilePackage package;
  std::vector<TileSums> sums{2};
  TileSnapshot snapshot;

  void Compare() {
    SumsOfTiles shared;
    for (const TileSums& of : sums) shared.push_back(std::make_shared<const TileSums>(of));
    CompareSample(package, shared, &snapshot);
  }
  Sampled() {
    package.tile = 3;
    package.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {7, 8, 9}};
    package.mesh.faces = {{0, 1, 2}, {3, 1, 2}, {3, 0, 1}};
    package.face_ids = {5, 9, 12};
    snapshot.positions = package.mesh.vertices;
    sums[0].tile = 3;
    sums[0].face_ids = {5};
    sums[1].tile = 4;
    sums[1].face_ids = {7, 9, 12};
    sums[0].sample.face_ids = {9, 12};
  }
  void Derivatives() {
    sums[0].photo.resize(1);
    sums[1].photo.resize(3);
    for (size_t i = 0; i < 3; ++i) sums[1].photo[i].gradient = {1.5f * static_cast<float>(i), 2, 3};
    sums[0].sample.photo = {sums[1].photo[1], sums[1].photo[2]};
  }
  void Labels() {
    for (TileSums& of : sums) {
      of.classes = 2;
      of.pixels.assign(of.face_ids.size(), 4);
      of.likelihoods.assign(2 * of.face_ids.size(), 0.25f);
    }
    sums[0].sample.pixels = {4, 4};
    sums[0].sample.likelihoods = {0.25f, 0.25f, 0.25f, 0.25f};
  }
};

TEST(CompareSample, CountsEqualSamples) {
  Sampled step, labels;
  step.Derivatives();
  labels.Labels();
  for (Sampled* of : {&step, &labels}) {
    of->Compare();
    EXPECT_EQ(of->snapshot.compared, 2);
    EXPECT_EQ(of->snapshot.different, 0);
  }
}

TEST(CompareSample, ReportsTheFaceOfABitDifference) {
  Sampled step;
  step.Derivatives();
  step.sums[1].photo[1].curvature[2] = std::nextafter(step.sums[1].photo[1].curvature[2], 1.0f);
  step.Compare();
  EXPECT_EQ(step.snapshot.compared, 2);
  EXPECT_EQ(step.snapshot.different, 1);
  EXPECT_EQ(step.snapshot.farthest_at, Eigen::Vector3d(7, 8, 9));
  ASSERT_EQ(SeamWarnings(3, step.snapshot).size(), 1u);
  Sampled labels;
  labels.Labels();
  labels.sums[0].sample.likelihoods[3] = 0.5f;
  labels.Compare();
  EXPECT_EQ(labels.snapshot.different, 1);
}

TEST(CompareSample, WithoutASecondTileNothingIsCompared) {
  Sampled step;
  step.Derivatives();
  step.sums.pop_back();
  step.Compare();
  EXPECT_EQ(step.snapshot.compared, 0);
  EXPECT_TRUE(SeamWarnings(3, step.snapshot).empty());
}

}  // namespace
}  // namespace tessera
