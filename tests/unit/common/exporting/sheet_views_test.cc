#include "common/exporting/sheet_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

// A camera at `centre` that looks down, with x to the east, and sees 100 x 80 m from 100 m above.
SceneView ViewFromAbove(const Eigen::Vector3d& centre) {
  SceneView view;
  view.camera.intrinsics = {1000, 800, 1000, 1000, 500, 400};
  view.camera.rotation_cam_from_world = Eigen::Vector3d(1, -1, -1).asDiagonal();
  view.camera.translation_cam_from_world = -view.camera.rotation_cam_from_world * centre;
  return view;
}

TEST(SheetViewsTest, FindsTheViewsThatShowAPartOfTheBox) {
  const std::vector<SceneView> views = {
      ViewFromAbove({0, 0, 100}),    // above the box
      ViewFromAbove({59, 0, 100}),   // its image ends inside
      ViewFromAbove({61, 0, 100}),   // ends outside
      ViewFromAbove({0, 49, 100}),   // the short side
      ViewFromAbove({0, 51, 100}),   //
      ViewFromAbove({0, 0, -5}),     // below the box, looks away
      ViewFromAbove({3, 3, 1}),      // in the box
      ViewFromAbove({0, 0, 10000}),  // sees all of it
  };
  const Eigen::AlignedBox3d box(Eigen::Vector3d(-10, -10, 0), Eigen::Vector3d(10, 10, 2));
  EXPECT_THAT(ViewsOfBox(views, box), testing::ElementsAre(0, 1, 3, 6, 7));
  EXPECT_THAT(ViewsOfBox(views, Eigen::AlignedBox3d()), testing::IsEmpty());
}

}  // namespace
}  // namespace tessera
