#include "worker/publish/outdated_faces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Two blocks of four cells in a row, one face per cell of one metre; face 100 + x is in cell x.
constexpr CellRect kLeft{0, 0, 4, 1}, kRight{4, 0, 8, 1};

CollectedFaces Row() {
  CollectedFaces faces;
  for (uint32_t x = 0; x < 8; ++x) {
    const auto first = static_cast<uint32_t>(faces.mesh.vertices.size());
    for (const double dx : {0.4, 0.5, 0.6}) faces.mesh.vertices.emplace_back(x + dx, 0.5, 3);
    faces.mesh.faces.push_back({first, first + 1, first + 2});
    faces.face_ids.push_back(100 + x);
  }
  return faces;
}

class OutdatedFacesTest : public testing::Test {
 protected:
  OutdatedFacesTest() : measured_({0, 0, 8, 1}, 1), areas_(1) {
    measured_.after.height_m.assign(8, 3);
    areas_[0].followed = false;
    areas_[0].cells = {{1, 0}};
  }
  std::vector<uint32_t> Find(const std::vector<uint32_t>& base) {
    OutdatedFaceFinder finder(ground_, measured_, base, &areas_);
    for (const CellRect& block : {kRight, kLeft}) {
      asked_.push_back(finder.Asks(block));
      if (asked_.back()) finder.Add(Row(), block);
    }
    return std::move(finder).Finish();
  }

  GroundPlane ground_ = MakeGroundPlane(Eigen::Vector3d::UnitZ(), 1);
  ChangeRaster measured_;
  std::vector<ChangeArea> areas_;
  std::vector<bool> asked_;  // results of Asks for the right and the left block
};

TEST_F(OutdatedFacesTest, FacesOfUnfollowedAreasAreFoundOnce) {
  EXPECT_THAT(Find({}), ElementsAre(100, 101, 102));
  EXPECT_EQ(areas_[0].outdated_faces, 3);
  EXPECT_THAT(asked_, ElementsAre(false, true));
}

TEST_F(OutdatedFacesTest, NoneWhereTheMeshFollows) {
  areas_[0].followed = true;
  EXPECT_THAT(Find({}), IsEmpty());
  EXPECT_EQ(areas_[0].outdated_faces, 0);
}

TEST_F(OutdatedFacesTest, BaseFacesRemainOutdatedWhereNothingWasMeasured) {
  measured_.after.height_m[6] = std::numeric_limits<float>::quiet_NaN();
  // 7 is not in the blocks; 101 is found again; 105 is correct now; 106 is unknown.
  EXPECT_THAT(Find({7, 101, 105, 106, 900}), ElementsAre(7, 100, 101, 102, 106, 900));
  EXPECT_THAT(asked_, ElementsAre(true, true));
}

TEST_F(OutdatedFacesTest, FileRoundTrip) {
  const StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  const std::string path = folder->path() + "/outdated.arrays";
  ASSERT_TRUE(WriteOutdatedFaces(path, {3, 9, 4000000000}).ok());
  const auto read = OutdatedFaces::Open(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_THAT(read->ids(), ElementsAre(3, 9, 4000000000));
  ASSERT_TRUE(WriteOutdatedFaces(path, {3, 9, 9}).ok());
  EXPECT_EQ(OutdatedFaces::Open(path).status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
