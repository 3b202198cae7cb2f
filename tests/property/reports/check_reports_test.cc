// What `tessera check` says of the scenes of public reports.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <tuple>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "common/check/check.h"
#include "common/classify/annotations.h"
#include "common/scene/scene.h"
#include "tests/property/reports/report_cases.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

// A triangle's corners, from the smallest on, and its label.
using LabelledTriangle = std::tuple<std::array<double, 9>, int32_t>;

// What a job reads of a scene.
struct SceneContent {
  std::vector<PixelContent> pixels;         // of the views, by the hashes of their images
  std::vector<PosedCamera> cameras;         // in the same order
  std::vector<LabelledTriangle> triangles;  // sorted
};

SceneContent ContentOf(const std::string& scene, const SceneSummary& summary) {
  SceneContent content;
  Warnings warnings;
  const auto description = LoadScene(scene, &warnings);
  if (!description.ok()) ADD_FAILURE() << description.status();
  if (!description.ok()) return content;
  std::map<std::string, size_t> views;  // their order follows the names of files, which some cases change
  for (size_t v = 0; v < summary.contents.size(); ++v) views.emplace(summary.contents[v].image, v);
  EXPECT_EQ(views.size(), description->views.size());
  for (const auto& [image, v] : views) {
    content.pixels.push_back(summary.contents[v]);
    content.cameras.push_back(description->views[v].camera);
  }
  const auto mesh = LoadSceneMesh(*description, 0, &warnings);
  if (!mesh.ok()) ADD_FAILURE() << mesh.status();
  if (!mesh.ok()) return content;
  for (size_t f = 0; f < mesh->faces.size(); ++f) {
    std::array<std::array<double, 3>, 3> corners;
    for (int k = 0; k < 3; ++k) {
      for (int axis = 0; axis < 3; ++axis) corners[k][axis] = mesh->Corner(f, k)[axis];
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    std::array<double, 9> flat;
    for (int k = 0; k < 9; ++k) flat[k] = corners[k / 3][k % 3];
    content.triangles.emplace_back(flat, mesh->labels.empty() ? -1 : mesh->labels[f]);
  }
  std::sort(content.triangles.begin(), content.triangles.end());
  return content;
}

// The content of a good scene; read once.
const SceneContent& GoodContent(Like like) {
  static std::map<Like, SceneContent> contents;
  if (!contents.contains(like)) {
    const std::string scene = FreshTestFolder("good") + "/scene";
    bent::CopyBaseScene(scene);
    if (like == Like::kPlainNpy) bent::PlainNpy(scene);
    if (like == Like::kPlainLabels) bent::PlainLabels(scene);
    Warnings warnings;
    const auto summary = CheckSceneFolder(scene, &warnings, {});
    if (!summary.ok()) ADD_FAILURE() << summary.status();
    contents[like] = summary.ok() ? ContentOf(scene, *summary) : SceneContent();
    fs::remove_all(scene);
  }
  return contents[like];
}

void ExpectSameContent(const SceneContent& found, const SceneContent& expected) {
  ASSERT_EQ(found.pixels.size(), expected.pixels.size());
  ASSERT_EQ(found.cameras.size(), expected.cameras.size());
  for (size_t v = 0; v < expected.pixels.size(); ++v) {
    EXPECT_EQ(found.pixels[v].image, expected.pixels[v].image) << "view " << v;
    EXPECT_EQ(found.pixels[v].likelihood, expected.pixels[v].likelihood) << "view " << v;
    const PosedCamera &a = found.cameras[v], &b = expected.cameras[v];
    EXPECT_LT((a.rotation_cam_from_world - b.rotation_cam_from_world).norm(), 1e-9) << "view " << v;
    EXPECT_LT((a.translation_cam_from_world - b.translation_cam_from_world).norm(), 1e-6) << "view " << v;
    EXPECT_EQ(a.intrinsics.width, b.intrinsics.width);
    EXPECT_DOUBLE_EQ(a.intrinsics.fx, b.intrinsics.fx);
    EXPECT_DOUBLE_EQ(a.intrinsics.cx, b.intrinsics.cx);
  }
  EXPECT_TRUE(found.triangles == expected.triangles) << "the mesh or its labels";
}

bool HasWords(const std::string& text, const std::vector<std::string>& words) {
  const std::string lower = absl::AsciiStrToLower(text);
  return std::all_of(words.begin(), words.end(),
                     [&](const std::string& word) { return absl::StrContains(lower, absl::AsciiStrToLower(word)); });
}

class CheckOfReports : public testing::TestWithParam<ReportCase> {};

TEST_P(CheckOfReports, SaysWhatIsExpected) {
  constexpr size_t kMaxMessage = 10000;  // bytes that a person reads
  const ReportCase& report = GetParam();
  const std::string scene = FreshTestFolder("bent") + "/scene";
  bent::CopyBaseScene(scene);
  report.bend(scene);
  Warnings warnings;
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const StatusOr<SceneSummary> summary = CheckSceneFolder(scene, &warnings, {});
  const std::string on_stderr = testing::internal::GetCapturedStderr();
  const std::string on_stdout = testing::internal::GetCapturedStdout();
  EXPECT_EQ(on_stderr + on_stdout, "") << "words of libraries on the terminal";
  const std::string message(summary.status().message()), told = absl::StrJoin(warnings, "\n");
  SCOPED_TRACE("fault: " + message + "\nwarnings: " + told);
  if (report.expect == Expect::kRefused) {
    EXPECT_EQ(summary.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_TRUE(HasWords(message, report.words)) << "expected: " << absl::StrJoin(report.words, ", ");
    EXPECT_LT(message.size(), kMaxMessage);
  } else {
    ASSERT_TRUE(summary.ok());
    const bool is_told = std::any_of(warnings.begin(), warnings.end(),
                                     [&](const std::string& warning) { return HasWords(warning, report.words); });
    if (report.expect == Expect::kGood) {
      EXPECT_TRUE(warnings.empty());
    } else if (!report.words.empty()) {
      EXPECT_TRUE(is_told) << "expected: " << absl::StrJoin(report.words, ", ");
    }
    if (report.like != Like::kNone) ExpectSameContent(ContentOf(scene, *summary), GoodContent(report.like));
  }
  fs::remove_all(scene);
}

INSTANTIATE_TEST_SUITE_P(All, CheckOfReports, testing::ValuesIn(ReportCases()), [](const auto& report) {
  std::string name = report.param.name;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST(CheckOfBaseScene, IsGood) {
  Warnings warnings;
  const auto summary = CheckSceneFolder(bent::BaseScene(), &warnings, {});
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_THAT(warnings, testing::IsEmpty());
}

// Report 33. Transparent pixels are no evidence; black ones are.
TEST(MasksOfReports, AreNotReadAsBlack) {
  std::string hashes[2];
  for (const bool is_transparent : {false, true}) {
    const std::string folder = FreshTestFolder(is_transparent ? "transparent" : "black") + "/scene";
    bent::CopyBaseScene(folder);
    (is_transparent ? bent::TransparentMasks : bent::BlackMasks)(folder);
    Warnings warnings;
    const auto scene = LoadScene(folder, &warnings);
    ASSERT_TRUE(scene.ok()) << scene.status();
    const auto content = ReadPixelContent(folder, scene->views[0], 4);
    ASSERT_TRUE(content.ok()) << content.status();
    hashes[is_transparent] = content->image;
  }
  EXPECT_NE(hashes[0], hashes[1]);
}

// Report 96. Colours that are mixed, as JPEG and painting programs mix them, are refused rather than guessed.
TEST(AnnotationsOfReports, AreReadOrRefused) {
  struct Form {
    const char* name;
    std::vector<std::string> refusal;  // words; empty: the same labels as those of ids
  };
  const Form forms[] = {{"ids", {}},
                        {"colours", {}},
                        {"palette", {}},
                        {"double-suffix", {}},
                        {"jpeg-colours", {"colour", "nadir_00_001"}},
                        {"antialiased", {"colour", "east_00_001"}},
                        {"half-size", {"200 x 150", "400 x 300"}}};
  const std::string folder = FreshTestFolder("annotations");
  Warnings warnings;
  const auto scene = LoadScene(bent::BaseScene(), &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  std::vector<LabelImage> ids;
  for (const Form& form : forms) {
    SCOPED_TRACE(form.name);
    const std::string of_form = folder + "/" + form.name;
    bent::PaintAnnotations(of_form, form.name);
    testing::internal::CaptureStderr();
    const StatusOr<Annotations> annotations = ReadAnnotations(of_form, *scene, &warnings);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    if (!form.refusal.empty()) {
      EXPECT_EQ(annotations.status().code(), absl::StatusCode::kInvalidArgument);
      EXPECT_TRUE(HasWords(std::string(annotations.status().message()), form.refusal)) << annotations.status();
      continue;
    }
    ASSERT_TRUE(annotations.ok()) << annotations.status();
    ASSERT_EQ(annotations->images.size(), 4u);
    for (size_t i = 0; i < annotations->images.size(); ++i) {
      if (ids.size() <= i) ids.push_back(annotations->images[i].labels);
      EXPECT_EQ(annotations->images[i].labels.data, ids[i].data);
    }
  }
}

}  // namespace
}  // namespace tessera
