// Validation by inspections of the parts of a scene gives what validation of its files gives.
#include "common/check/inspection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/base/parallel.h"
#include "common/check/check.h"
#include "common/imaging/image_io.h"
#include "common/scene/image_files.h"
#include "common/storage/allowed_files.h"
#include "tests/support/tiny_scene.h"
#include "tests/support/wide_tiff.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::UnorderedElementsAre;

namespace fs = std::filesystem;

// What validation says, without the scene's folder.
struct Verdict {
  std::string error, summary;
  Warnings warnings;
  std::vector<std::string> contents, skipped;
  std::vector<BorderTrust> borders;
  bool operator==(const Verdict&) const = default;
};

std::vector<std::string> FilesIn(const std::string& folder) { return AllowedFiles::All().List(folder).value(); }

class InspectionTest : public testing::Test {
 protected:
  // Puts each view's files, with the camera model, in a folder, and the rest of the scene in `rest_`.
  void Split() {
    fs::remove_all(parts_);
    fs::remove_all(rest_);
    inspections_ = Inspections();
    std::set<std::string> parts;
    const std::vector<std::string> files = FilesIn(folder_);
    for (const std::string& file : files) {
      if (IsPixelFile(file)) parts.insert(PixelStem(file));
    }
    const auto put = [&](const std::string& file, const std::string& target) {
      fs::create_directories(fs::path(target + "/" + file).parent_path());
      fs::copy_file(folder_ + "/" + file, target + "/" + file);
    };
    for (const std::string& file : files) {
      if (IsPixelFile(file)) {
        put(file, parts_ + "/" + PixelStem(file));
        continue;
      }
      put(file, rest_);
      if (file == "mesh.ply") continue;
      for (const std::string& part : parts) put(file, parts_ + "/" + part);
    }
    for (const std::string& part : parts) {
      const StatusOr<PartInspection> found = InspectPart(parts_ + "/" + part, {}, {});
      ASSERT_TRUE(found.ok()) << found.status();
      const ThreadLimit one(1);
      EXPECT_EQ(InspectPart(parts_ + "/" + part, {}, {})->json, found->json);
      EXPECT_EQ(found->has_faults, faulty_.contains(part)) << part;
      ASSERT_TRUE(inspections_.Add(found->json, rest_).ok());
    }
  }

  Verdict Check(const std::string& folder, const InspectedFiles& files) const {
    Verdict verdict;
    const StatusOr<CheckedScene> checked =
        CheckScene(folder, load_, std::numeric_limits<int64_t>::max(), &verdict.warnings, {}, files);
    const auto plain = [&](const std::string& text) { return absl::StrReplaceAll(text, {{folder, "scene"}}); };
    for (std::string& warning : verdict.warnings) warning = plain(warning);
    verdict.error = plain(std::string(checked.status().message()));
    for (const InputFault& fault : FaultsOf(checked.status())) absl::StrAppend(&verdict.error, "\n", plain(fault.file));
    if (!checked.ok()) return verdict;
    verdict.summary = SummaryToJson(checked->summary, {});
    ReplaceAllNames(&verdict.summary);
    for (const PixelContent& content : checked->summary.contents) {
      verdict.contents.insert(verdict.contents.end(),
                              {content.image, content.likelihood, std::to_string(content.masked_share)});
    }
    for (const SkippedImage& image : checked->scene.skipped) verdict.skipped.push_back(image.name + image.reason);
    for (int a = 0; a < checked->summary.borders.classes(); ++a) {
      for (int b = 0; b < checked->summary.borders.classes(); ++b) {
        verdict.borders.push_back(checked->summary.borders.Of(a, b));
      }
    }
    return verdict;
  }
  // A scene without a name is called as its folder.
  void ReplaceAllNames(std::string* text) const {
    *text = absl::StrReplaceAll(*text, {{fs::path(rest_).filename().string(), "scene"}});
  }

  // The same verdict by the files as by the inspections; returns it. fetched_: pixel files that the latter read.
  Verdict CheckBoth() {
    Split();
    const Verdict whole = Check(folder_, {});
    fetched_.clear();
    const Verdict parts = Check(rest_, {inspections_, [&](const std::vector<std::string>& paths) {
                                          for (const std::string& path : paths) {
                                            if (fs::exists(path)) continue;
                                            const fs::path file = fs::path(path).lexically_relative(rest_);
                                            fs::create_directories(fs::path(path).parent_path());
                                            fs::copy_file(folder_ / file, path);
                                            fetched_.insert(file.generic_string());
                                          }
                                          return absl::OkStatus();
                                        }});
    EXPECT_EQ(whole.error, parts.error);
    EXPECT_EQ(whole.warnings, parts.warnings);
    EXPECT_EQ(whole.summary, parts.summary);
    EXPECT_TRUE(whole == parts);
    return whole;
  }

  std::string Image(int view) const { return folder_ + "/images/view" + std::to_string(view) + ".png"; }
  std::string Likelihoods(int view) const { return folder_ + "/likelihoods/view" + std::to_string(view) + ".tif"; }

  const std::string all_ = FreshTestFolder("inspection");
  const std::string folder_ = all_ + "/scene", parts_ = all_ + "/parts", rest_ = all_ + "/rest";
  SceneLoadOptions load_;
  Inspections inspections_;
  std::set<std::string> faulty_, fetched_;
};

TEST_F(InspectionTest, GoodScenesAreReadOnceOnly) {
  for (const auto likelihoods : {TinySceneOptions::Likelihoods::kNpy, TinySceneOptions::Likelihoods::kNone}) {
    fs::remove_all(folder_);
    WriteTinyScene(folder_, {.likelihoods = likelihoods});
    EXPECT_EQ(CheckBoth().error, "");
    // For the fit alone.
    EXPECT_THAT(fetched_, UnorderedElementsAre("images/view0.png", "images/view1.png", "images/view2.png",
                                               "images/view3.png", "images/view4.png"));
  }
}

TEST_F(InspectionTest, MasksAndDistortion) {
  WriteTinyScene(folder_, {.k1 = -0.05});
  fs::create_directory(folder_ + "/masks");
  ByteImage mask(160, 120, 1, 255);
  std::fill_n(mask.data.begin(), 160 * 30, uint8_t{0});
  ASSERT_TRUE(WritePng(folder_ + "/masks/view1.png", mask).ok());
  ASSERT_TRUE(WritePng(folder_ + "/masks/view3.mask.png", mask).ok());
  const Verdict verdict = CheckBoth();
  EXPECT_EQ(verdict.error, "");
  EXPECT_THAT(verdict.warnings, Contains(HasSubstr("2 images have a mask")));
  EXPECT_THAT(fetched_, Not(Contains(HasSubstr("likelihoods"))));
}

TEST_F(InspectionTest, FaultsOfAllPartsAreReportedTogether) {
  WriteTinyScene(folder_);
  const std::string image = ReadText(Image(0));
  WriteText(Image(0), image.substr(0, image.size() / 2));
  WriteText(Image(1), "no image");
  ASSERT_TRUE(WriteLikelihoodTiff(Likelihoods(2), ByteImage(160, 120, 2, 100)).ok());
  fs::create_directory(folder_ + "/masks");
  ASSERT_TRUE(WritePng(folder_ + "/masks/view3.png", ByteImage(160, 160, 1, 255)).ok());
  WriteText(folder_ + "/masks/view4.png", "no mask");
  faulty_ = {"view0", "view1", "view2", "view3", "view4"};
  const Verdict verdict = CheckBoth();
  for (const char* file :
       {"images/view0.png", "images/view1.png", "likelihoods/view2.tif", "masks/view3.png", "masks/view4.png"}) {
    EXPECT_THAT(verdict.error, HasSubstr(file));
  }
  EXPECT_THAT(fetched_, IsEmpty());
}

TEST_F(InspectionTest, BrokenImagesAreSkipped) {
  WriteTinyScene(folder_, {.tower = true});
  const std::string image = ReadText(Image(2));
  WriteText(Image(2), image.substr(0, image.size() / 2));
  WriteText(Image(4), "no image");
  fs::remove(Image(5));
  faulty_ = {"view2", "view4"};
  load_.skip_images = 0.5;
  const Verdict verdict = CheckBoth();
  EXPECT_EQ(verdict.error, "");
  EXPECT_EQ(verdict.skipped.size(), 3);
  load_.skip_images = 0.1;
  EXPECT_THAT(CheckBoth().error, HasSubstr("to leave out the 3 missing or broken images"));
}

TEST_F(InspectionTest, CopiesInDifferentPartsAreFound) {
  WriteTinyScene(folder_);
  fs::copy_file(Image(1), Image(3), fs::copy_options::overwrite_existing);
  load_.anyway = true;
  EXPECT_THAT(CheckBoth().warnings, Contains(HasSubstr("1 image has the same pixels as another one")));
}

// A part sees neither the highest sample nor the highest class of the whole scene: its files are read again.
TEST_F(InspectionTest, PartsThatSuggestAnotherFormAreReadAgain) {
  WriteTinyScene(folder_, {.likelihoods = TinySceneOptions::Likelihoods::kLabelPng});
  for (int view = 0; view < 5; ++view) {
    const ByteImage picture = *ReadRgb(Image(view));
    WriteTiff16(Image(view), picture, view == 2 ? 2 : 16);  // of ten bits, and of twelve
    const std::string path = folder_ + "/likelihoods/view" + std::to_string(view) + ".png";
    LabelImage labels = *ReadLabelImage(path);
    for (uint8_t& label : labels.data) {  // ids from 1; without the highest in the last view
      if (label < 3) label = view == 4 && label == 2 ? 2 : static_cast<uint8_t>(label + 1);
    }
    ASSERT_TRUE(WritePng(path, labels).ok());
  }
  const Verdict verdict = CheckBoth();
  EXPECT_EQ(verdict.error, "");
  EXPECT_THAT(verdict.warnings, AllOf(Contains(HasSubstr("4095 is taken as white")),
                                      Contains(HasSubstr("class ids of label images count from 1"))));
  EXPECT_THAT(fetched_, AllOf(Contains("likelihoods/view2.png"), Contains("likelihoods/view4.png"),
                              Not(Contains("likelihoods/view1.png"))));
}

// Files that were inspected in different parts, because their names differ.
TEST_F(InspectionTest, FilesOfAViewInDifferentPartsAreReadAgain) {
  WriteTinyScene(folder_);
  fs::create_directory(folder_ + "/masks");
  ASSERT_TRUE(WritePng(folder_ + "/masks/view1.png", ByteImage(160, 120, 1, 255)).ok());
  Split();
  Inspections separate;
  for (const std::string& file : FilesIn(folder_)) {
    if (!IsPixelFile(file)) continue;
    const std::string part = parts_ + "/alone";
    fs::remove_all(part);
    fs::copy(folder_, part, fs::copy_options::recursive);
    for (const std::string& other : FilesIn(part)) {
      if (IsPixelFile(other) && other != file) fs::remove(part + "/" + other);
    }
    ASSERT_TRUE(separate.Add(InspectPart(part, {}, {})->json, folder_).ok());
  }
  const Verdict whole = Check(folder_, {});
  EXPECT_EQ(whole.error, "");
  EXPECT_TRUE(whole == Check(folder_, {separate, {}}));
}

TEST_F(InspectionTest, DamagedInspectionsAreRefused) {
  WriteTinyScene(folder_);
  const std::string json = InspectPart(folder_, {}, {})->json;
  Inspections inspections;
  for (const std::string& damaged : {std::string(), std::string("{}"), json.substr(0, json.size() / 2),
                                     absl::StrReplaceAll(json, {{"\"borders\":[0", "\"borders\":[-1"}}),
                                     absl::StrReplaceAll(json, {{"\"size\":[160,120]", "\"size\":[160,1200]"}}),
                                     absl::StrReplaceAll(json, {{"\"size\":[160,120]", "\"size\":[1e99,120]"}}),
                                     absl::StrReplaceAll(json, {{"\"runs\":[", "\"runs\":[7,4000000000,"}})}) {
    EXPECT_EQ(inspections.Add(damaged, folder_).code(), absl::StatusCode::kInvalidArgument) << damaged.substr(0, 200);
  }
  EXPECT_TRUE(inspections.Add(json, folder_).ok());
}

TEST_F(InspectionTest, FailedFetchIsAnErrorOfItsOwn) {
  WriteTinyScene(folder_);
  Split();
  const StatusOr<CheckedScene> checked = CheckScene(
      rest_, {}, std::numeric_limits<int64_t>::max(), nullptr, {},
      {inspections_, [](const std::vector<std::string>&) { return absl::UnavailableError("no connection"); }});
  EXPECT_EQ(checked.status(), absl::UnavailableError("no connection"));
}

}  // namespace
}  // namespace tessera
