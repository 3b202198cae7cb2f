// Likelihoods that say nothing, or contradict labels, slopes or the up direction.
#include "common/check/label_findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <limits>

#include "absl/strings/str_cat.h"
#include "common/check/check.h"
#include "common/imaging/image_io.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

class LabelFindingsTest : public testing::Test {
 protected:
  // A scene with likelihoods of three classes: `values` of classes 0 to 2 for a pixel of this class.
  template <class Values>
  void Write(const Values& values, const TinySceneOptions& options = {}) {
    const TinyScene scene = WriteTinyScene(folder_, options);
    for (size_t v = 0; v < scene.label_pictures.size(); ++v) {
      const LabelImage& labels = scene.label_pictures[v];
      ByteImage pages(labels.width, labels.height, 3, 0);
      for (size_t i = 0; i < labels.data.size(); ++i) {
        for (int c = 0; c < 3 && labels.data[i] < 3; ++c) pages.plane(c)[i] = values(labels.data[i])[c];
      }
      ASSERT_TRUE(WriteLikelihoodTiff(absl::StrCat(folder_, "/likelihoods/view", v, ".tif"), pages).ok());
    }
  }
  // The warnings of `tessera check`.
  Warnings Check() {
    Warnings warnings;
    const StatusOr<SceneSummary> summary = CheckSceneFolder(folder_, &warnings, {});
    EXPECT_TRUE(summary.ok()) << summary.status();
    if (summary.ok()) has_likelihoods_ = summary->has_likelihoods;
    return warnings;
  }
  static std::array<uint8_t, 3> Named(int label, int named = 200) {
    std::array<uint8_t, 3> values = {25, 25, 25};
    values[label] = static_cast<uint8_t>(named);
    return values;
  }

  const std::string folder_ = FreshTestFolder("scene");
  bool has_likelihoods_ = false;
};

TEST_F(LabelFindingsTest, GoodScenesGetNoWarning) {
  Write([](int label) { return Named(label); });
  EXPECT_THAT(Check(), IsEmpty());
  EXPECT_TRUE(has_likelihoods_);
}

TEST_F(LabelFindingsTest, LikelihoodsWithoutAPreferenceAreIgnored) {
  for (const uint8_t value : {0, 85}) {
    Write([&](int) { return std::array<uint8_t, 3>{value, value, value}; });
    EXPECT_THAT(Check(), Contains(AllOf(HasSubstr("equally likely everywhere, in all images"),
                                        HasSubstr("and the mesh's labels stay"))));
    EXPECT_FALSE(has_likelihoods_);
  }
  SceneDescription scene = LoadScene(folder_, nullptr).value();
  IgnoreLikelihoods(&scene);
  EXPECT_FALSE(scene.has_likelihoods);
  EXPECT_EQ(scene.views[0].likelihood_path, "");
  EXPECT_EQ(scene.classes.size(), 3u);
  scene.mesh_has_labels = false;
  IgnoreLikelihoods(&scene);
  EXPECT_THAT(ClassNames(scene), testing::ElementsAre("surface"));
}

TEST_F(LabelFindingsTest, OneImageWithoutAPreferenceIsNamed) {
  Write([](int label) { return Named(label); });
  ASSERT_TRUE(WriteLikelihoodTiff(folder_ + "/likelihoods/view3.tif", ByteImage(160, 120, 3, 7)).ok());
  EXPECT_THAT(Check(), testing::ElementsAre(HasSubstr("in 1 of 5 images, such as 'view3.png'")));
  EXPECT_TRUE(has_likelihoods_);
}

TEST_F(LabelFindingsTest, UnevenSumsMayBeLogits) {
  Write([](int label) { return Named(label, 40 + 80 * label); });
  const std::string text = "the values of a pixel sum to 90 to 250";
  EXPECT_THAT(Check(), Contains(AllOf(HasSubstr(text), HasSubstr("set \"likelihood_values\": \"logits\""))));
  ReplaceInFile(folder_ + "/scene.json", "{", "{\"likelihood_values\": \"probabilities\", ");
  EXPECT_THAT(Check(), IsEmpty());
}

TEST_F(LabelFindingsTest, AnotherOrderOfClassesIsNamed) {
  Write([](int label) { return Named((label + 1) % 3); });
  const auto is_named = AllOf(HasSubstr("agree with the mesh's labels at 0 %"),
                              HasSubstr("if the order of the likelihoods' classes is roof, ground, facade"));
  Warnings warnings;
  const StatusOr<SceneSummary> refused = CheckSceneFolder(folder_, &warnings, {});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(refused.status().message()), AllOf(is_named, HasSubstr("--anyway")));
  SceneLoadOptions anyway;
  anyway.anyway = true;
  const auto accepted = CheckScene(folder_, anyway, std::numeric_limits<int64_t>::max(), &warnings, {});
  EXPECT_TRUE(accepted.ok()) << accepted.status();
  EXPECT_THAT(warnings, Contains(is_named));
}

TEST_F(LabelFindingsTest, DisagreementWithoutAnOrderIsReported) {
  Write([](int) { return Named(2); });
  EXPECT_THAT(Check(), Contains(HasSubstr("check that both have the order of 'classes'")));
}

TEST_F(LabelFindingsTest, SlopesDecideWithoutLabels) {
  TinySceneOptions options;
  options.labels = false;
  Write([](int label) { return Named(label); }, options);
  EXPECT_THAT(Check(), IsEmpty());
  Write([](int label) { return Named(label == 0 ? 1 : 0); }, options);
  EXPECT_THAT(Check(), Contains(HasSubstr("of the faces of class 'facade' have a slope of this class")));
}

TEST_F(LabelFindingsTest, TheAxisThatFitsAsUpIsNamed) {
  Write([](int label) { return Named(label); });
  for (const char* up : {"[0, 0, -1]", "[0, 1, 0]", "[-1, 0, 0]"}) {
    SceneDescription scene = LoadScene(folder_, nullptr).value();
    const std::vector<double> axis = up[1] == '-'   ? std::vector<double>{-1, 0, 0}
                                     : up[4] == '1' ? std::vector<double>{0, 1, 0}
                                                    : std::vector<double>{0, 0, -1};
    scene.up_in_local = Eigen::Map<const Eigen::Vector3d>(axis.data());
    Warnings warnings;
    EXPECT_TRUE(WarnOfUp(scene, &warnings)) << up;
    EXPECT_THAT(warnings, testing::ElementsAre(
                              AllOf(HasSubstr(absl::StrCat("with ", up, " as up")), HasSubstr("\"up\": [0, 0, 1]"))));
  }
}

TEST_F(LabelFindingsTest, FilesMayDifferInTheCaseOfLetters) {
  Write([](int label) { return Named(label); });
  std::filesystem::rename(folder_ + "/likelihoods/view1.tif", folder_ + "/likelihoods/View1.TIF");
  std::filesystem::rename(folder_ + "/likelihoods/view2.tif", folder_ + "/likelihoods/VIEW2.png.tif");
  const StatusOr<SceneDescription> scene = LoadScene(folder_, nullptr);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->views[1].likelihood_path, "likelihoods/View1.TIF");
  EXPECT_EQ(scene->views[2].likelihood_path, "likelihoods/VIEW2.png.tif");
}

TEST_F(LabelFindingsTest, FormsAreFoundOverAllFiles) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kLabelPng;
  const TinyScene tiny = WriteTinyScene(folder_, options);
  for (size_t v = 0; v < tiny.label_pictures.size(); ++v) {
    LabelImage labels = tiny.label_pictures[v];
    for (uint8_t& label : labels.data) label = label == 255 ? 255 : label + 1;
    ASSERT_TRUE(WritePng(absl::StrCat(folder_, "/likelihoods/view", v, ".png"), labels).ok());
  }
  Warnings warnings;
  const StatusOr<CheckedScene> checked = CheckScene(folder_, {}, std::numeric_limits<int64_t>::max(), &warnings, {});
  ASSERT_TRUE(checked.ok()) << checked.status();
  for (const SceneView& view : checked->scene.views) EXPECT_EQ(view.likelihood_form.first_id, 1) << view.name;
  EXPECT_THAT(warnings, testing::ElementsAre(HasSubstr("count from 1")));
  SceneDescription scene = LoadScene(folder_, nullptr).value();
  LikelihoodForm other;
  other.first_id = 0;
  FindLikelihoodForms(&scene, &warnings, {{"likelihoods/view1.png", other}});
  EXPECT_EQ(scene.views[1].likelihood_form, other);
}

}  // namespace
}  // namespace tessera
