#include "common/importing/image_paths.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class FindImagesTest : public testing::Test {
 protected:
  void SetUp() override {
    auto folder = TempFolder::Create("");
    ASSERT_TRUE(folder.ok());
    folder_.emplace(*std::move(folder));
    root_ = fs::canonical(folder_->path()).string();
    fs::create_directories(root_ + "/project");
    source_ = root_ + "/project/block.xml";
    ASSERT_TRUE(WriteFileAtomic(source_, "").ok());
  }
  std::string Make(const std::string& name) {
    const std::string path = absl::StrCat(root_, "/", name);
    fs::create_directories(fs::path(path).parent_path());
    EXPECT_TRUE(WriteFileAtomic(path, "an image").ok());
    return path;
  }
  void Find(const std::vector<std::string>& paths) {
    ImportedBlock block;
    block.images.resize(paths.size());
    for (size_t i = 0; i < paths.size(); ++i) {
      block.images[i].path = paths[i];
      block.images[i].location = absl::StrCat("photo ", i);
    }
    block.missing_images = missing_;
    faults_ = Faults();
    found_ = FindImages(block, source_, search_, &faults_);
  }

  std::optional<TempFolder> folder_;
  std::string root_, source_;
  PhotographSearch search_;
  std::vector<std::string> missing_;
  Faults faults_;
  std::vector<FoundImage> found_;
};

TEST_F(FindImagesTest, PathsOfAnotherMachineAreFoundByTheirLongestCommonEnd) {
  const std::string a = Make("project/flight/a/IMG_1.JPG"), b = Make("project/flight/b/IMG_1.JPG");
  Find({"D:\\data\\flight\\a\\IMG_1.jpg", "D:\\data\\flight\\b\\IMG_1.jpg"});
  EXPECT_THAT(faults_.messages(), ElementsAre());
  EXPECT_EQ(found_[0].file, a);
  EXPECT_EQ(found_[1].file, b);
}

TEST_F(FindImagesTest, NamesAreTheShortestEndsThatDiffer) {
  Make("project/a/IMG_1.jpg"), Make("project/b/IMG_1.jpg"), Make("project/b/IMG_2.jpg");
  Find({"E:/x/a/IMG_1.jpg", "E:/x/b/IMG_1.jpg", "E:/x/b/IMG_2.jpg"});
  EXPECT_EQ(found_[0].name, "a/IMG_1.jpg");
  EXPECT_EQ(found_[1].name, "b/IMG_1.jpg");
  EXPECT_EQ(found_[2].name, "IMG_2.jpg");
}

TEST_F(FindImagesTest, NamesStayInTheImagesFolder) {
  Make("IMG_1.jpg");
  Find({"../IMG_1.jpg"});
  EXPECT_EQ(found_[0].file, root_ + "/IMG_1.jpg");
  EXPECT_EQ(found_[0].name, "IMG_1.jpg");
}

TEST_F(FindImagesTest, AnImageWithTwoFilesOfEqualRightIsRefused) {
  const std::string a = Make("project/a/IMG_1.jpg"), b = Make("project/b/IMG_1.jpg");
  Find({"D:\\c\\IMG_1.jpg"});
  EXPECT_THAT(faults_.messages(), ElementsAre(testing::AllOf(HasSubstr(a), HasSubstr(b), HasSubstr("photo 0"))));
  EXPECT_EQ(found_[0].file, "");
}

TEST_F(FindImagesTest, TwoImagesOfOneFileAreRefused) {
  Make("project/IMG_1.jpg");
  Find({"D:\\c\\IMG_1.jpg", "D:\\d\\IMG_1.jpg"});
  EXPECT_THAT(faults_.messages(), ElementsAre(HasSubstr("expected a file for each image")));
}

TEST_F(FindImagesTest, LabelsWithoutAnExtensionAreFoundAndGetThatOfTheirFile) {
  const std::string file = Make("project/flight/DSC_1.TIF");
  Find({"DSC_1"});
  EXPECT_TRUE(faults_.empty());
  EXPECT_EQ(found_[0].file, file);
  EXPECT_EQ(found_[0].name, "DSC_1.TIF");
}

TEST_F(FindImagesTest, ReplacementsComeFirstAndReplaceWholeNames) {
  Make("project/IMG_1.jpg");
  const std::string other = Make("other/IMG_1.jpg");
  search_.replacements = {{"D:\\flights\\of\\the\\year\\before", "/longer/than/the/path"},
                          {"D:\\fl", root_ + "/wrong"},
                          {"D:\\flights", root_ + "/other"}};
  Find({"d:\\flights\\IMG_1.jpg"});
  EXPECT_EQ(found_[0].file, other);
}

TEST_F(FindImagesTest, FoldersOfImagesReplaceTheSourcesFolder) {
  Make("project/IMG_1.jpg");
  const std::string other = Make("other/deep/IMG_1.jpg");
  search_.folders = {root_ + "/other"};
  Find({"D:\\IMG_1.jpg"});
  EXPECT_EQ(found_[0].file, other);
}

TEST_F(FindImagesTest, TheLastFaultNamesTheOptionThatFindsMostMissingImages) {
  Make("photos/may/IMG_1.jpg"), Make("photos/may/IMG_2.jpg");
  Find({"D:\\x\\may\\IMG_1.jpg", "D:\\x\\may\\IMG_2.jpg", "D:\\x\\may\\IMG_3.jpg"});
  ASSERT_EQ(faults_.messages().size(), 4u);
  EXPECT_THAT(faults_.messages()[0], HasSubstr("photo 0: found no file of image 'D:\\x\\may\\IMG_1.jpg'"));
  EXPECT_THAT(faults_.messages()[3],
              HasSubstr(absl::StrCat("no file for 3 of 3 images, expected all of them: --image-path 'D:/x'='", root_,
                                     "/photos' finds 2")));
}

// Their reader needed the file for the size, and left the image out.
TEST_F(FindImagesTest, TheLastFaultCountsImagesThatTheReaderMissed) {
  Make("photos/may/IMG_1.jpg"), Make("photos/may/IMG_2.jpg"), Make("project/IMG_3.jpg");
  missing_ = {"D:\\x\\may\\IMG_1.jpg", "D:\\x\\may\\IMG_2.jpg"};
  Find({"D:\\x\\IMG_3.jpg"});
  EXPECT_THAT(faults_.messages(),
              ElementsAre(HasSubstr(absl::StrCat("no file for 2 of 3 images, expected all of them: --image-path "
                                                 "'D:/x'='",
                                                 root_, "/photos' finds 2"))));
}

// A replaced path would have to name a file.
TEST_F(FindImagesTest, ForLabelsTheFolderIsNamed) {
  Make("photos/may/IMG_1.jpg");
  Find({"may/IMG_1"});
  EXPECT_THAT(faults_.messages().back(), HasSubstr(absl::StrCat("--images '", root_, "/photos' finds 1")));
}

TEST_F(FindImagesTest, ScenesOfEarlierImportsAreNotSearched) {
  const std::string file = Make("project/IMG_1.jpg");
  Make("project/scene/images/IMG_1.jpg"), Make("project/scene/import.json");
  Find({"D:\\x\\IMG_1.jpg"});
  EXPECT_EQ(found_[0].file, file);
}

TEST_F(FindImagesTest, ImagesWithoutAPoseNeedNoFile) {
  ImportedBlock block;
  block.images.resize(1);
  block.images[0].path = "IMG_1.jpg";
  block.images[0].oriented = false;
  found_ = FindImages(block, source_, search_, &faults_);
  EXPECT_TRUE(faults_.empty());
}

TEST(ParsePathReplacementTest, NeedsTwoParts) {
  EXPECT_EQ(ParsePathReplacement("D:\\a=/b")->to, "/b");
  EXPECT_FALSE(ParsePathReplacement("D:\\a").ok());
  EXPECT_FALSE(ParsePathReplacement("=/b").ok());
  EXPECT_FALSE(ParsePathReplacement("D:\\a=").ok());
}

}  // namespace
}  // namespace tessera
