// FaceGatherer against sums over pixels of barycentric coordinates that are computed per pixel.
#include "worker/photo/face_sums.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <set>
#include <tuple>

#include "tests/support/draw_views.h"

namespace tessera {
namespace {

constexpr int kWidth = 96, kHeight = 80, kStripHeight = 32;

PosedCamera CameraAtOrigin() {
  PosedCamera camera;
  camera.intrinsics = {kWidth, kHeight, 70, 70, 0.5 * kWidth, 0.5 * kHeight};
  return camera;
}

// A relief of small faces, and in front of a part of it a face with a corner behind the camera.
TriangleMesh SmallFacesAndOneThatReachesBehindTheCamera() {
  constexpr int kSide = 24;
  TriangleMesh mesh;
  for (int i = 0; i <= kSide; ++i) {
    for (int j = 0; j <= kSide; ++j) {
      mesh.vertices.emplace_back(0.7 * (j - 12) + 0.03 * i, 0.6 * (i - 12), 9 + 0.8 * ((i + 2 * j) % 3));
    }
  }
  for (uint32_t i = 0; i < kSide; ++i) {
    for (uint32_t j = 0; j < kSide; ++j) {
      const uint32_t a = i * (kSide + 1) + j, b = a + 1, c = a + kSide + 1, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  }
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.emplace_back(-3, -1, 5);
  mesh.vertices.emplace_back(3, -1, 6);
  mesh.vertices.emplace_back(0, -2, -2);
  mesh.faces.push_back({first, first + 1, first + 2});
  return mesh;
}

ReferenceStrip RandomStrip(const FaceMap& map, int row_begin, int row_end, std::mt19937* random) {
  ReferenceStrip strip;
  strip.Reset(map.width, map.height, 3, row_begin, row_end);
  std::uniform_real_distribution<float> value(-1, 1);
  for (int y = row_begin; y < row_end; ++y) {
    for (int x = 0; x < map.width; ++x) {
      strip.depth.row(y)[x] = map.depth[static_cast<size_t>(y) * map.width + x];
      strip.gradient.row(y)[x] = value(*random);
      strip.curvature.row(y)[x] = 1 + value(*random);
      strip.count.row(y)[x] = 2 + value(*random);
    }
  }
  return strip;
}

// Barycentric coordinates of the point of the face's plane at this pixel.
Eigen::Vector3d Barycentric(const TriangleMesh& mesh, int32_t face, const PosedCamera& camera, int x, int y, double z) {
  Eigen::Matrix3d corners;
  for (int c = 0; c < 3; ++c) corners.col(c) = mesh.Corner(face, c);
  const PinholeCamera& k = camera.intrinsics;
  return corners.inverse() * Eigen::Vector3d(z * (x + 0.5 - k.cx) / k.fx, z * (y + 0.5 - k.cy) / k.fy, z);
}

class FaceSumsTest : public testing::TestWithParam<std::tuple<bool, StripSums>> {};

TEST_P(FaceSumsTest, AreTheSumsOverThePixelsOfEachFace) {
  const TriangleMesh mesh = SmallFacesAndOneThatReachesBehindTheCamera();
  const PosedCamera camera = CameraAtOrigin();
  const FaceMap map = RasterizeFaces(mesh, {camera, {0, 0, kWidth, kHeight}});
  const size_t n = mesh.faces.size();
  std::vector<uint8_t> own;
  if (std::get<0>(GetParam())) {
    for (size_t f = 0; f < n; ++f) own.push_back(f % 3 != 0);
  }
  const MeshPart all = {{{0, static_cast<uint32_t>(n)}}, {{0, static_cast<uint32_t>(mesh.vertices.size())}}};
  const int strips = (kHeight + kStripHeight - 1) / kStripHeight;
  std::vector<FaceSums> sums(n);
  std::vector<Eigen::Matrix3d> expected(n, Eigen::Matrix3d::Zero());  // rows: gradient, curvature; pairs, pixels
  std::vector<int> strips_of_face(n, 0);
  std::mt19937 random(7);
  FaceGatherer gatherer;
  FaceSlots slots;
  gatherer.Begin(mesh, all, camera, map, own, strips, std::get<1>(GetParam()), &sums);
  for (int s = 0; s < strips; ++s) {
    const ReferenceStrip strip =
        RandomStrip(map, s * kStripHeight, std::min(kHeight, (s + 1) * kStripHeight), &random);
    gatherer.AddStrip(s, strip, &slots);
    std::vector<uint8_t> met(n, 0);
    for (int y = strip.row_begin; y < strip.row_end; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int32_t face = map.face[static_cast<size_t>(y) * kWidth + x];
        if (face < 0 || (!own.empty() && !own[face])) continue;
        const Eigen::Vector3d share = Barycentric(mesh, face, camera, x, y, strip.depth.row(y)[x]);
        expected[face].row(0) += strip.gradient.row(y)[x] * share.transpose();
        expected[face].row(1) += strip.curvature.row(y)[x] * share.transpose();
        expected[face].row(2) += Eigen::RowVector3d(strip.count.row(y)[x], 1, 0);
        strips_of_face[face] += met[face] == 0;
        met[face] = 1;
      }
    }
  }
  gatherer.JoinStrips();
  gatherer.Finish();

  int seen = 0, in_several_strips = 0;
  for (size_t f = 0; f < n; ++f) {
    const double pixels = expected[f](2, 1);
    seen += pixels > 0;
    in_several_strips += strips_of_face[f] > 1;
    EXPECT_NEAR(sums[f].pairs, pixels > 0 ? expected[f](2, 0) / pixels : 0, 1e-5);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(sums[f].gradient[c], expected[f](0, c), 1e-4 * (1 + pixels)) << "face " << f;
      EXPECT_NEAR(sums[f].curvature[c], expected[f](1, c), 1e-4 * (1 + pixels)) << "face " << f;
    }
  }
  EXPECT_GT(seen, 300);
  EXPECT_GT(in_several_strips, 20);
  EXPECT_GT(expected[n - 1](2, 1), own.empty() || own[n - 1] ? 100 : -1) << "the face that reaches behind the camera";
}

TEST(FaceSlotsTest, TakeRoomForTheFacesOfAStripOnly) {
  constexpr int32_t kFaces = 10000000;
  constexpr size_t kPage = size_t{1} << FaceSlots::kPageBits;
  FaceSlots slots;
  for (int strip = 0; strip < 3; ++strip) {
    slots.Begin(kFaces);
    // Other faces in each strip: the first of the mesh, the last, and one between.
    const int32_t between = 1000 * (strip + 1);
    const std::set<uint32_t> places = {slots.SlotOf(0), slots.SlotOf(1), slots.SlotOf(between),
                                       slots.SlotOf(kFaces - 1)};
    EXPECT_EQ(places.size(), 4U);
    EXPECT_LT(*places.rbegin(), slots.slots.size());
    EXPECT_EQ(slots.SlotOf(between), slots.SlotOf(between));
    EXPECT_LE(slots.slots.size(), 3 * kPage);
  }
}

INSTANTIATE_TEST_SUITE_P(OwnFaces, FaceSumsTest,
                         testing::Combine(testing::Bool(), testing::Values(StripSums::kAtOnce, StripSums::kWait)));

}  // namespace
}  // namespace tessera
