// A scene in an S3 store is read as the same scene in a folder.
#include "common/scene/stored_scenes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "absl/strings/str_replace.h"
#include "common/scene/scene_upload.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/servers/test_s3.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

class StoredScenesTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("radosgw");
    s3_ = std::make_unique<TestS3>();
    root_ = ToText(s3_->location);
    scenes_ = *StoredScenes::Open({root_}, s3_->location.endpoint, "", s3_->credentials.get(), &s3_->clock, {});
  }
  // A copy of the good scene, changed by `bend`.
  void Make(const std::function<void(const std::string&)>& bend = {}) {
    fs::remove_all(scene_);
    bent::CopyBaseScene(scene_);
    if (bend) bend(scene_);
  }
  // Stores the scene's folder under `name` below the root; returns its URL.
  std::string Upload(const std::string& name = "city") {
    S3Location location = s3_->location;
    location.prefix += name + "/";
    TestS3 target({}, location);
    const auto uploaded = UploadScene(scene_, *target.client, {});
    EXPECT_TRUE(uploaded.ok()) << uploaded.status();
    return root_ + name;
  }
  StatusOr<SceneDescription> Load(const std::string& url, Warnings* warnings = nullptr,
                                  const SceneLoadOptions& options = {}) {
    TESSERA_ASSIGN_OR_RETURN(const FetchedScene fetched, FetchScene(*scenes_, url, {}));
    return LoadFetchedScene(fetched, warnings, options);
  }
  int64_t ReceivedBytes() const { return scenes_->counts()["get"].received_bytes; }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string scene_ = folder_.path() + "/city";
  std::unique_ptr<TestS3> s3_;
  std::string root_;
  std::unique_ptr<StoredScenes> scenes_;
};

TEST_F(StoredScenesTest, DescriptionAndFaultsAreThoseOfTheFolder) {
  using Bend = void (*)(const std::string&);
  const std::pair<const char*, Bend> bends[] = {
      {"base", nullptr},
      {"RealityScanText", bent::RealityScanText},
      {"SubModels", bent::SubModels},
      {"FisheyeBinary", bent::FisheyeBinary},
      {"Backslashes", bent::Backslashes},
      {"CaseOfExtension", bent::CaseOfExtension},
      {"OneImageMissing", bent::OneImageMissing},
      {"NonAsciiNames", bent::NonAsciiNames},
      {"HalfSizeImages", bent::HalfSizeImages},
      {"StaleRigPoses", bent::StaleRigPoses},
      {"OldBinaryBesideText", bent::OldBinaryBesideText},
      {"LfsPointers", bent::LfsPointers},
      {"JpgAndPngOfOneStem", bent::JpgAndPngOfOneStem},
      {"NamesWithDotSlash", bent::NamesWithDotSlash},
      {"ManyMissing", bent::ManyMissing},
      {"SamePhotoTwice", bent::SamePhotoTwice},
      {"TurnedPortrait", bent::TurnedPortrait},
      {"TruncatedJpeg", bent::TruncatedJpeg},
      {"ZeroBytes", bent::ZeroBytes},
      {"BlackMasks", bent::BlackMasks},
      {"TransparentMasks", bent::TransparentMasks},
      {"UpperCaseSuffix", bent::UpperCaseSuffix},
      {"HalfOfTheLikelihoods", bent::HalfOfTheLikelihoods},
      {"NoLabels", bent::NoLabels},
      {"LabelsOnVertices", bent::LabelsOnVertices},
      {"ObjCalledPly", bent::ObjCalledPly},
      {"no mesh", [](const std::string& scene) { fs::remove(scene + "/mesh.ply"); }},
      {"no model", [](const std::string& scene) { fs::remove_all(scene + "/colmap"); }},
      {"no likelihoods", [](const std::string& scene) { fs::remove_all(scene + "/likelihoods"); }},
      {"no scene.json but its faults",
       [](const std::string& scene) {
         std::ofstream(scene + "/scene.json") << R"({"tessera_scene": 1, "clases": 1})";
       }},
  };
  int refused = 0;
  for (const auto& [name, bend] : bends) {
    SCOPED_TRACE(name);
    Make(bend == nullptr ? std::function<void(const std::string&)>() : bend);
    const std::string url = Upload(absl::StrReplaceAll(name, {{" ", "_"}}) + std::string("/city"));
    for (const double skip_images : {0.0, 0.3}) {
      SceneLoadOptions options;
      options.skip_images = skip_images;
      Warnings of_folder, of_store;
      const auto folder = LoadScene(scene_, &of_folder, options);
      const auto store = Load(url, &of_store, options);
      ASSERT_EQ(store.ok(), folder.ok()) << folder.status() << "\n" << store.status();
      if (!folder.ok()) {
        ++refused;
        EXPECT_EQ(std::string(store.status().message()),
                  absl::StrReplaceAll(folder.status().message(), {{scene_, url}}));
        continue;
      }
      for (std::string& warning : of_folder) warning = absl::StrReplaceAll(warning, {{scene_, url}});
      EXPECT_EQ(of_store, of_folder);
      EXPECT_EQ(store->files, folder->files);
      EXPECT_TRUE(DigestsOf(FetchScene(*scenes_, url, {})->manifest, store->files).ok());
      EXPECT_EQ(store->name, folder->name);
      EXPECT_EQ(ClassNames(*store), ClassNames(*folder));
      EXPECT_EQ(store->mesh_has_labels, folder->mesh_has_labels);
      ASSERT_EQ(store->views.size(), folder->views.size());
      for (size_t v = 0; v < folder->views.size(); ++v) {
        EXPECT_EQ(store->views[v].image_path, folder->views[v].image_path);
        EXPECT_EQ(store->views[v].mask_path, folder->views[v].mask_path);
        EXPECT_EQ(store->views[v].masked, folder->views[v].masked);
        EXPECT_EQ(store->views[v].likelihood_path, folder->views[v].likelihood_path);
        EXPECT_EQ(store->views[v].camera.intrinsics.width, folder->views[v].camera.intrinsics.width);
        EXPECT_EQ(store->views[v].camera.translation_cam_from_world,
                  folder->views[v].camera.translation_cam_from_world);
      }
    }
  }
  EXPECT_GE(refused, 20);
}

TEST_F(StoredScenesTest, ReadsNoPixels) {
  Make();
  const std::string url = Upload();
  int64_t model = 0, all = 0;
  for (const fs::directory_entry& file : fs::recursive_directory_iterator(scene_)) {
    if (!file.is_regular_file()) continue;
    all += static_cast<int64_t>(file.file_size());
    if (file.path().parent_path() == scene_ + "/colmap") model += static_cast<int64_t>(file.file_size());
  }
  const int64_t before = ReceivedBytes();
  const auto fetched = FetchScene(*scenes_, url + "/scene.json", {});
  ASSERT_TRUE(fetched.ok()) << fetched.status();
  EXPECT_LT(ReceivedBytes() - before, model + kMeshHeadBytes + 40'000) << "of " << all;
  const auto scene = LoadFetchedScene(*fetched, nullptr, {});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const auto digests = DigestsOf(fetched->manifest, scene->files);
  ASSERT_TRUE(digests.ok()) << digests.status();
  EXPECT_EQ(digests->size(), scene->files.size());
  for (const NamedDigest& file : *digests) EXPECT_EQ(file.digest, *HashFile(scene_ + "/" + file.name));
  EXPECT_FALSE(DigestsOf(fetched->manifest, {"images/none.jpg"}).ok());
}

TEST_F(StoredScenesTest, ChangesSinceTheManifestAreTold) {
  Make();
  const std::string url = Upload();
  const auto put = [&](const std::string& name, const std::string& content) {
    ASSERT_TRUE(s3_->client->Put("city/" + name, content, Sha256Hex(content)).ok());
  };
  put("images/new.jpg", "not in the manifest");
  Warnings warnings;
  ASSERT_TRUE(Load(url, &warnings).ok());
  EXPECT_THAT(warnings, testing::Contains(HasSubstr("does not have 1 files of the scene, such as images/new.jpg")));

  const std::string image = LoadScene(scene_, nullptr)->views[0].image_path;
  put(image, "short");
  EXPECT_THAT(std::string(Load(url).status().message()),
              AllOf(HasSubstr(url + "/" + image + ": found 5 bytes, expected "), HasSubstr("repeat tessera upload")));

  const auto cameras = ReadFile(scene_ + "/colmap/cameras.txt");
  ASSERT_TRUE(cameras.ok());
  put("colmap/cameras.txt", absl::StrReplaceAll(*cameras, {{"400", "401"}}));
  EXPECT_THAT(std::string(Load(url).status().message()), HasSubstr(url + "/colmap/cameras.txt: found the content"));

  ASSERT_TRUE(s3_->client->Delete({"city/" + image}).ok());
  put("colmap/cameras.txt", *cameras);
  EXPECT_THAT(std::string(Load(url).status().message()), HasSubstr(url + "/" + image + ": found no such file"));

  ASSERT_TRUE(s3_->client->Delete({std::string("city/") + kManifestName}).ok());
  EXPECT_THAT(std::string(Load(url).status().message()), HasSubstr("write it by tessera upload SCENE " + url));
}

TEST_F(StoredScenesTest, OtherPlacesAreRefused) {
  for (const std::string url : {"s3://other/city", "s3://tests/city", "s3://tests"}) {
    EXPECT_THAT(std::string(Load(url).status().message()), HasSubstr("found a place that is in no --scene-root"))
        << url;
  }
  std::string beside = root_;
  beside.pop_back();
  EXPECT_FALSE(scenes_->Find(beside + "-more/city").ok());
  EXPECT_FALSE(Load(root_ + "../city").ok());
  EXPECT_FALSE(Load(root_ + "city//..").ok());
}

TEST_F(StoredScenesTest, IsCancelled) {
  Make();
  EXPECT_EQ(FetchScene(*scenes_, Upload(), [] { return true; }).status().code(), absl::StatusCode::kCancelled);
}

// A job fails for a file that cannot come back, and waits for a store that does not answer.
TEST_F(StoredScenesTest, HashOfASceneFileTellsAnOutageFromAChangedFile) {
  Make();
  const std::string url = Upload(), file = url + "/scene.json";
  const Digest digest = *HashFile(scene_ + "/scene.json");
  EXPECT_EQ(*HashSceneFile(scene_ + "/scene.json", nullptr), digest);
  EXPECT_EQ(*HashSceneFile(file, scenes_.get()), digest);
  EXPECT_TRUE(absl::IsNotFound(HashSceneFile(url + "/no-file", scenes_.get()).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(HashSceneFile("s3://elsewhere/scene.json", scenes_.get()).status()));
  EXPECT_TRUE(absl::IsUnavailable(HashSceneFile(file, nullptr).status()));
  S3ClientOptions once;
  once.retry.max_attempts = 1;
  const auto away = *StoredScenes::Open({root_}, "http://127.0.0.1:1", "", s3_->credentials.get(), &s3_->clock, once);
  EXPECT_TRUE(absl::IsUnavailable(HashSceneFile(file, away.get()).status()));
}

}  // namespace
}  // namespace tessera
