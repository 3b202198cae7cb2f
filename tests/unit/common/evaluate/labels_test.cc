#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "common/evaluate/boundary.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/label_rendering.h"
#include "tests/unit/common/evaluate/flat_world.h"

namespace tessera {
namespace {

LabelImage Image(const std::vector<std::string>& rows) {
  LabelImage image(static_cast<int>(rows[0].size()), static_cast<int>(rows.size()));
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      image.at(x, y) = rows[y][x] == '.' ? 255 : static_cast<uint8_t>(rows[y][x] - '0');
    }
  }
  return image;
}

TEST(ConfusionMatrix, ScoresByHand) {
  ConfusionMatrix confusion(3);
  confusion.Add(0, 0, 6);
  confusion.Add(0, 1, 2);
  confusion.Add(1, 1, 1);
  confusion.Add(1, 255, 1);   // nothing rendered: wrong
  confusion.Add(255, 0, 50);  // nothing in the truth: ignored
  confusion.Add(-1, 0, 50);
  const LabelScores s = ScoreLabels(confusion);
  EXPECT_EQ(s.counted, 10);
  EXPECT_EQ(confusion.at(1, 3), 1);
  EXPECT_NEAR(s.overall_accuracy, 0.7, 1e-12);
  EXPECT_NEAR(s.average_accuracy, (0.75 + 0.5) / 2, 1e-12);  // class 2 is not in the truth
  EXPECT_NEAR(s.mean_iou, (6.0 / 8 + 1.0 / 4) / 2, 1e-12);
  EXPECT_NEAR(s.classes[1].precision, 1.0 / 3, 1e-12);
  EXPECT_TRUE(std::isnan(s.classes[2].recall));
}

TEST(ConfusionMatrix, CountsAreAdditive) {
  ConfusionMatrix a(2), b(2);
  a.Add(0, 1, 2);
  b.Add(0, 1, 3);
  b.Add(1, 1);
  a.Add(b);
  EXPECT_EQ(a.at(0, 1), 5);
  EXPECT_EQ(a.total(), 6);
}

TEST(ConfusionMatrix, EmptyCountsGiveNaN) {
  EXPECT_TRUE(std::isnan(ScoreLabels(ConfusionMatrix(2)).overall_accuracy));
  EXPECT_TRUE(std::isnan(ScoreLabels(ConfusionMatrix(2)).average_accuracy));
}

std::vector<BoundaryCounts> Counts(const LabelImage& result, const LabelImage& truth, int reach_px) {
  std::vector<BoundaryCounts> counts(2);
  CountBoundaries(result, truth, reach_px, &counts);
  return counts;
}

TEST(BoundaryF, EqualImagesScoreOne) {
  const LabelImage image = Image({"0011", "0011", "0111"});
  EXPECT_DOUBLE_EQ(MeanBoundaryF(Counts(image, image, 0)), 1);
}

TEST(BoundaryF, ShiftedEdgeMatchesWithinDistance) {
  const LabelImage truth = Image({"00000011111111", "00000011111111"});
  const LabelImage shifted = Image({"00000000011111", "00000000011111"});  // by 3 px
  EXPECT_DOUBLE_EQ(MeanBoundaryF(Counts(shifted, truth, 3)), 1);
  EXPECT_DOUBLE_EQ(MeanBoundaryF(Counts(shifted, truth, 2)), 0);
  const auto counts = Counts(shifted, truth, 2);
  EXPECT_EQ(counts[0].result, 2);
  EXPECT_EQ(counts[0].truth, 2);
  EXPECT_EQ(counts[0].result_matched, 0);
}

TEST(BoundaryF, ExtraEdgeReducesPrecisionOnly) {
  const LabelImage truth = Image({"0000000000", "0000000000", "1111111111"});
  const LabelImage result = Image({"0000000000", "0000000000", "1111111111"});
  LabelImage speckled = result;
  speckled.at(9, 0) = 1;
  const auto counts = Counts(speckled, truth, 0);
  EXPECT_EQ(counts[1].truth, 10);
  EXPECT_EQ(counts[1].truth_matched, 10);
  EXPECT_EQ(counts[1].result, 11);
  EXPECT_EQ(counts[1].result_matched, 10);
}

TEST(BoundaryF, UnknownTruthIsNotABoundary) {
  const LabelImage truth = Image({"00..11", "00..11"});
  const auto counts = Counts(Image({"000111", "000111"}), truth, 3);
  EXPECT_EQ(counts[0].truth + counts[1].truth + counts[0].result + counts[1].result, 0);
  EXPECT_TRUE(std::isnan(MeanBoundaryF(counts)));
}

TEST(RenderLabels, RendersFaceLabels) {
  const TriangleMesh mesh = FlatSquare(10, 2, 0);
  const SceneView view = ViewFromAbove({5, 5, 100}, 20, 40);  // the square is the picture's middle
  const LabelImage image = RenderLabels(mesh, RayCaster(mesh), view.camera);
  EXPECT_EQ(image.at(15, 20), 0);
  EXPECT_EQ(image.at(25, 20), 1);
  EXPECT_EQ(image.at(5, 20), 255);
  int64_t shown = 0;
  for (uint8_t label : image.data) shown += label != 255;
  EXPECT_EQ(shown, 400);
}

TEST(RenderLabels, FacesWithoutLabelRenderAs255) {
  TriangleMesh mesh = FlatSquare(10, 2, 0);
  mesh.labels.assign(mesh.faces.size(), -1);
  const SceneView view = ViewFromAbove({5, 5, 100}, 20, 40);
  EXPECT_EQ(RenderLabels(mesh, RayCaster(mesh), view.camera).at(15, 20), 255);
}

TEST(UndistortLabels, ScalesToTheCameraSize) {
  LensModel lens;
  lens.pinhole = {6, 4, 5, 5, 3, 2};
  const LabelImage image = UndistortLabels(Image({"012", "120"}), lens);
  EXPECT_EQ(image.width, 6);
  EXPECT_EQ(image.at(0, 0), 0);
  EXPECT_EQ(image.at(5, 1), 2);
  EXPECT_EQ(image.at(3, 2), 2);
}

TEST(UndistortLabels, SamplesTheDistortedPosition) {
  LensModel lens;
  lens.kind = LensModel::Kind::kSimpleRadial;
  lens.pinhole = {101, 101, 100, 100, 50.5, 50.5};
  lens.coefficients[0] = -0.2;
  LabelImage stored(101, 101);
  for (int y = 0; y < 101; ++y) {
    for (int x = 0; x < 101; ++x) stored.at(x, y) = static_cast<uint8_t>(x);
  }
  const LabelImage image = UndistortLabels(stored, lens);
  EXPECT_EQ(image.at(50, 50), 50);
  // x = 0.4 from the centre moves to 0.4 (1 - 0.2 * 0.16) = 0.3872.
  EXPECT_EQ(image.at(90, 50), 50 + 39);
}

}  // namespace
}  // namespace tessera
