#include "server/admission/scene_files.h"

#include <gmock/gmock.h>

#include <fstream>

#include "tests/unit/server/admission/admission_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Change times come from the machine's clock; tests cannot set them.
class SceneFilesTest : public AdmissionFixture {
 protected:
  SceneFilesTest() { clock_.SetBy(static_cast<double>(SystemClock().UnixTimeUs() - clock_.UnixTimeUs()) / 1e6); }
  AllowedFile Hold(const std::string& name) { return *AllowedFiles::All().Open(scene_ + "/" + name); }
};

TEST_F(SceneFilesTest, DigestsOfRecentlyChangedFilesAreNotCached) {
  const AllowedFile file = Hold("image");
  ASSERT_TRUE(DigestOfFile(file, *cache_, clock_).ok());
  EXPECT_FALSE(cache_->Find(file.real_path(), *file.Stamp()).has_value()) << "the file changed too recently";
  clock_.Advance(3600);
  const Digest digest = *DigestOfFile(file, *cache_, clock_);
  EXPECT_EQ(cache_->Find(file.real_path(), *file.Stamp()), digest);
  const auto missing = DigestSceneFiles(scene_, {"none1", "image", "none2"}, AllowedFiles::All(), *cache_, clock_);
  EXPECT_THAT(std::string(missing.status().message()), testing::AllOf(HasSubstr("none1"), HasSubstr("none2")));
}

TEST_F(SceneFilesTest, FileWithNewContentAndItsOldModificationTimeIsHashedAgain) {
  clock_.Advance(3600);
  const std::string path = scene_ + "/image";
  const auto written = std::filesystem::last_write_time(path);
  const Digest digest = *DigestOfFile(Hold("image"), *cache_, clock_);
  std::ofstream(path, std::ios::binary) << std::string(2'500'000, 'x') << "end";
  std::filesystem::last_write_time(path, written);
  const Digest other = *DigestOfFile(Hold("image"), *cache_, clock_);
  EXPECT_NE(other.sha256, digest.sha256);
  EXPECT_EQ(other.size_bytes, digest.size_bytes);
}

TEST_F(SceneFilesTest, CancellationStopsHashing) {
  EXPECT_EQ(DigestOfFile(Hold("image"), *cache_, clock_, [] { return true; }).status().code(),
            absl::StatusCode::kCancelled);
  EXPECT_EQ(
      DigestSceneFiles(scene_, {"image"}, AllowedFiles::All(), *cache_, clock_, [] { return true; }).status().code(),
      absl::StatusCode::kCancelled);
}

TEST_F(SceneFilesTest, CacheErrorsAreIgnored) {
  struct FullCache : DigestCache {
    std::optional<Digest> Find(const std::string&, const FileStamp&) override { return std::nullopt; }
    Status Remember(const std::string&, const FileStamp&, const Digest&) override {
      return absl::ResourceExhaustedError("disk is full");
    }
  } full;
  clock_.Advance(3600);
  EXPECT_EQ(DigestOfFile(Hold("image"), full, clock_).value(), HashFile(scene_ + "/image").value());
}

}  // namespace
}  // namespace tessera
