#include "worker/photo/data_term.h"

#include <gtest/gtest.h>

#include <memory>

#include "tests/support/held_pixels.h"
#include "tests/support/relief_scene.h"

namespace tessera {
namespace {

// A relief seen by all views, each matched with all others.
class DataTermTest : public testing::Test {
 protected:
  DataTermTest() {
    const TriangleMesh truth = HeightField(60, 5, ReliefHeight);
    const std::vector<PosedCamera> cameras = ReliefCameras(120);
    for (int v = 0; v < static_cast<int>(cameras.size()); ++v) {
      RefineView& view = views_.emplace_back();
      view.camera = cameras[v];
      view.pixels = std::make_shared<HeldPixels>(Photograph(truth, cameras[v], 1, 0.01, 10 + v));
      view.id = v;
      view.index = v;
      for (int w = 0; w < static_cast<int>(cameras.size()); ++w) {
        if (w != v) pairs_.push_back({v, w});
      }
    }
  }
  PhotoSums Evaluate(PairDirections directions) const {
    DataTerm term(views_, pairs_, groups_, nullptr, false, {});
    EXPECT_TRUE(term.EnterLevel(0).ok());
    FaceDerivatives out;
    term.Evaluate(mesh_, {}, directions, nullptr, &out);
    return out.photo;
  }

  const TriangleMesh mesh_ = HeightField(12, 4.5, ReliefHeight);
  const ViewGroups groups_;
  std::vector<RefineView> views_;
  std::vector<ViewPair> pairs_;
};

TEST_F(DataTermTest, BothDirectionsAreForwardAndBackward) {
  const PhotoSums both = Evaluate(PairDirections::kBoth), forward = Evaluate(PairDirections::kForward),
                  backward = Evaluate(PairDirections::kBackward);
  ASSERT_GT(both.warped_pixels, 0);
  EXPECT_EQ(forward.warped_pixels + backward.warped_pixels, both.warped_pixels);
  EXPECT_NEAR(forward.sums.energy + backward.sums.energy, both.sums.energy, 1e-9 * both.sums.energy);
  EXPECT_NE(forward.sums.energy, backward.sums.energy);
  for (size_t f = 0; f < mesh_.faces.size(); ++f) {
    for (int c = 0; c < 3; ++c) {
      const float curvature = both.faces[f].curvature[c], tolerance = 1e-4f * (1e-3f + curvature);
      EXPECT_NEAR(forward.faces[f].curvature[c] + backward.faces[f].curvature[c], curvature, tolerance) << f;
      EXPECT_NEAR(forward.faces[f].gradient[c] + backward.faces[f].gradient[c], both.faces[f].gradient[c],
                  10 * tolerance)
          << f;
    }
  }
}

TEST_F(DataTermTest, EachDirectionHasEveryPair) {
  const PhotoSums both = Evaluate(PairDirections::kBoth), forward = Evaluate(PairDirections::kForward),
                  backward = Evaluate(PairDirections::kBackward);
  for (size_t f = 0; f < mesh_.faces.size(); ++f) {
    if (both.faces[f].pairs < 2) continue;
    EXPECT_GT(forward.faces[f].pairs, 0.1f * both.faces[f].pairs) << f;
    EXPECT_GT(backward.faces[f].pairs, 0.1f * both.faces[f].pairs) << f;
  }
}

}  // namespace
}  // namespace tessera
