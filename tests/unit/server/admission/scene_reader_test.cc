#include "server/admission/scene_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "server/settings/job_settings.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class SceneReaderTest : public testing::Test {
 protected:
  void Write(TinySceneOptions::Likelihoods likelihoods, bool labels) {
    TinySceneOptions options;
    options.likelihoods = likelihoods;
    options.labels = labels;
    WriteTinyScene(scene_, options);
  }
  StatusOr<SceneListing> Read(const std::string& classifier = "") {
    return ReadScene(scene_ + "/", {true, classifier}, AllowedFiles::All());
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  const std::string scene_ = folder_.path() + "/scene";
};

TEST_F(SceneReaderTest, ListsTheFilesOfAScene) {
  Write(TinySceneOptions::Likelihoods::kTiff, true);
  const auto scene = Read();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->folder, scene_);
  EXPECT_THAT(scene->files, Not(IsEmpty()));
  for (const std::string& file : scene->files) EXPECT_TRUE(FileExists(scene_ + "/" + file)) << file;
  EXPECT_EQ(scene->classifier, "") << "the scene has likelihoods";
  EXPECT_EQ(scene->classifier_content, "");
}

TEST_F(SceneReaderTest, SceneWithoutLikelihoodsGetsTheDefaultClassifier) {
  Write(TinySceneOptions::Likelihoods::kNone, false);
  const auto scene = Read();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->classifier, kDefaultClassifier);
  EXPECT_EQ(scene->classifier_content, "");
  EXPECT_EQ(Read(kNoClassifier)->classifier, "");
}

TEST_F(SceneReaderTest, FaultsOfTheSceneAndTheClassifierAreErrors) {
  Write(TinySceneOptions::Likelihoods::kNone, false);
  EXPECT_EQ(Read(folder_.path() + "/none.json").status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/model.json", "no model").ok());
  EXPECT_EQ(Read(folder_.path() + "/model.json").status().code(), absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(RemoveTree(scene_ + "/scene.json").ok());
  const auto missing = Read();
  EXPECT_FALSE(missing.ok());
  EXPECT_THAT(std::string(missing.status().message()), HasSubstr("scene.json"));
}

}  // namespace
}  // namespace tessera
