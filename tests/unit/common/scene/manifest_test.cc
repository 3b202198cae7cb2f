#include "common/scene/manifest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

std::string ManifestText(const std::string& files) { return R"({"tessera_manifest": 1, "files": [)" + files + "]}"; }

std::string EntryText(const std::string& name, const std::string& rest = "") {
  return R"({"name": ")" + name + R"(", "size": 3, "sha256": ")" + Sha256Hex("abc") + "\"" + rest + "}";
}

TEST(Manifest, IsReadAsItWasWritten) {
  SceneManifest manifest;
  manifest.files.resize(3);
  manifest.files[0].name = "scene.json";
  manifest.files[0].digest = {Sha256Hex("s"), 1};
  manifest.files[1].name = "images/\"ü\".jpg";
  manifest.files[1].digest = {Sha256Hex("i"), 7};
  manifest.files[1].image = ImageHeader{{400, 300}, 16, true, 6};
  manifest.files[2].name = "images/b.tif";
  manifest.files[2].digest = {Sha256Hex("b"), 0};
  manifest.files[2].fault = InputFault{"", "byte 0", "an empty file", "an image"};
  const std::string text = ToJson(manifest);
  const StatusOr<SceneManifest> read = ParseManifest(text, "m");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->files.size(), 3u);
  EXPECT_EQ(read->files[0].name, "images/\"ü\".jpg");
  ASSERT_TRUE(read->files[0].image.has_value());
  EXPECT_EQ(read->files[0].image->size, (ImageSize{400, 300}));
  EXPECT_EQ(read->files[0].image->bits, 16);
  EXPECT_TRUE(read->files[0].image->has_alpha);
  EXPECT_EQ(read->files[0].image->orientation, 6);
  ASSERT_TRUE(read->files[1].fault.has_value());
  EXPECT_EQ(FaultOf(read->files[1], "city/").message(),
            "city/images/b.tif: byte 0: found an empty file, expected an image");
  EXPECT_TRUE(FaultOf(read->files[0], "").ok());
  EXPECT_FALSE(read->files[1].image.has_value());
  EXPECT_EQ(read->files[2].digest, (Digest{Sha256Hex("s"), 1}));
  EXPECT_EQ(ToJson(*read), text);
  EXPECT_EQ(FindFile(*read, "scene.json"), &read->files[2]);
  EXPECT_EQ(FindFile(*read, "none"), nullptr);
}

TEST(Manifest, RefusesWhatIsNone) {
  const struct {
    std::string text, words;
  } kCases[] = {
      {"", "no manifest"},
      {"[]", "no manifest"},
      {R"({"tessera_scene": 1})", "no manifest"},
      {R"({"tessera_manifest": 2, "files": []})", "another version"},
      {R"({"tessera_manifest": 1})", "no list"},
      {ManifestText("1"), "files[0]: found no object"},
      {ManifestText(EntryText("../a")), "files[0].name: found '../a'"},
      {ManifestText(EntryText("/a")), "a path inside the scene"},
      {ManifestText(EntryText("a/./b")), "a path inside the scene"},
      {ManifestText(EntryText("b") + "," + EntryText("a")), "files[1].name: found 'a', expected names in ascending"},
      {ManifestText(EntryText("a") + "," + EntryText("a")), "each once"},
      {ManifestText(R"({"name": "a", "size": 1.5, "sha256": ""})"), "files[0].size"},
      {ManifestText(R"({"name": "a", "size": 1, "sha256": "x"})"), "64 lower-case hex digits"},
      {ManifestText(EntryText("a", R"(, "image": {"width": 0, "height": 1})")), "files[0].image.width"},
      {ManifestText(EntryText("a", R"(, "image": 1)")), "files[0].image: found no object"},
      {ManifestText(EntryText("a", R"(, "fault": "text")")), "files[0].fault: found no object"},
      {ManifestText(EntryText("a", R"(, "fault": {"location": ""})")), "files[0].fault.found"},
      {ManifestText(EntryText("a", R"(, "modified_ns": -1)")), "files[0].modified_ns"},
      {std::string(100, '['), "nest"},
  };
  for (const auto& [text, words] : kCases) {
    const Status status = ParseManifest(text, "m").status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(status.message()), HasSubstr(words)) << text;
  }
}

TEST(Manifest, ReadsHeadersOfImages) {
  const TempFolder folder = TempFolder::Create("").value();
  const std::string image = folder.path() + "/a.jpg";
  ASSERT_TRUE(WriteJpeg(image, ByteImage(8, 6, 3), 90).ok());
  ManifestFile file{"images/a.jpg", {}};
  ReadImageFacts(image, &file);
  ASSERT_TRUE(file.image.has_value()) << FaultOf(file, "");
  EXPECT_EQ(file.image->size, (ImageSize{8, 6}));

  ManifestFile other_name{"photograph", {}};
  ReadImageFacts(image, &other_name);
  EXPECT_TRUE(other_name.image.has_value());

  const std::string text = folder.path() + "/text";
  ASSERT_TRUE(WriteFileAtomic(text, "no image").ok());
  ManifestFile broken{"images/b.JPG", {}};
  ReadImageFacts(text, &broken);
  EXPECT_FALSE(broken.image.has_value());
  EXPECT_THAT(std::string(FaultOf(broken, "").message()), HasSubstr("images/b.JPG: byte 0: found "));
  EXPECT_THAT(std::string(FaultOf(broken, "").message()), testing::Not(HasSubstr(folder.path())));

  ManifestFile mesh{"mesh.ply", {}};
  ReadImageFacts(text, &mesh);
  EXPECT_FALSE(mesh.image.has_value());
  EXPECT_FALSE(mesh.fault.has_value());
}

}  // namespace
}  // namespace tessera
