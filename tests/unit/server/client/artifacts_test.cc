#include "server/client/artifacts.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "common/storage/files.h"
#include "common/storage/zip_writer.h"
#include "tessera/v1/jobs.pb.h"
#include "tests/support/fake_workers_service.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

class ArtifactsTest : public testing::Test {
 protected:
  ArtifactsTest()
      : folder_(TempFolder::Create(testing::TempDir()).value()),
        out_(folder_.path() + "/out"),
        connection_(Connection::Open(coordinator_.address(), 20).value()) {}

  Digest AddArtifact(const std::string& name, const std::string& content) {
    const Digest digest = coordinator_.blobs().Add(content);
    v1::Artifact* artifact = job_.add_artifacts();
    artifact->set_name(name);
    artifact->mutable_digest()->set_sha256(digest.sha256);
    artifact->mutable_digest()->set_size_bytes(digest.size_bytes);
    return digest;
  }
  StatusOr<std::vector<std::string>> Fetch() { return FetchArtifacts(*connection_, job_, out_, out_ + "/.fetch", {}); }

  TempFolder folder_;
  const std::string out_;
  FakeWorkersService coordinator_;
  std::unique_ptr<Connection> connection_;
  v1::Job job_;
};

TEST_F(ArtifactsTest, ReplacesExistingFilesAndWritesMeshLast) {
  ASSERT_TRUE(EnsureFolder(out_).ok());
  ASSERT_TRUE(WriteFileAtomic(out_ + "/mesh.ply", "old").ok());
  AddArtifact("mesh.ply", "new mesh");
  AddArtifact("report.json", "{}");
  AddArtifact("pictures/before.png", "{}");  // the same content twice
  const auto written = Fetch();
  ASSERT_TRUE(written.ok()) << written.status();
  EXPECT_EQ(written->back(), out_ + "/mesh.ply");
  EXPECT_EQ(ReadFile(out_ + "/mesh.ply").value(), "new mesh");
  EXPECT_EQ(ReadFile(out_ + "/report.json").value(), "{}");
  EXPECT_EQ(ReadFile(out_ + "/pictures/before.png").value(), "{}");
  EXPECT_FALSE(fs::exists(out_ + "/.fetch"));
}

TEST_F(ArtifactsTest, NoFileAppearsUntilAllAreVerified) {
  ASSERT_TRUE(EnsureFolder(out_).ok());
  ASSERT_TRUE(WriteFileAtomic(out_ + "/mesh.ply", "old").ok());
  AddArtifact("report.json", "{}");
  coordinator_.blobs().Replace(AddArtifact("mesh.ply", "new mesh"), "bad mesh");
  EXPECT_EQ(Fetch().status().code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(fs::exists(out_ + "/report.json"));
  EXPECT_EQ(ReadFile(out_ + "/mesh.ply").value(), "old");
}

// The content of an archive of these members.
std::string ZipOf(const std::string& folder, const std::vector<std::string>& members) {
  for (const std::string& member : members) {
    const std::string path = folder + "/in/" + member;
    EXPECT_TRUE(EnsureFolder(fs::path(path).parent_path().string()).ok());
    EXPECT_TRUE(WriteFileAtomic(path, "content of " + member).ok());
  }
  EXPECT_TRUE(WriteStoredZip(folder + "/archive", folder + "/in", members).ok());
  return ReadFile(folder + "/archive").value();
}

TEST_F(ArtifactsTest, ArchivesOfSheetsAreUnpackedInTheirPlace) {
  AddArtifact("export/3dtiles/0_-1.zip", ZipOf(folder_.path(), {"0_-1.json", "nodes/0_-1_2.glb"}));
  AddArtifact("export/3dtiles/tileset.json", "{}");
  const auto written = Fetch();
  ASSERT_TRUE(written.ok()) << written.status();
  const std::string folder = out_ + "/export/3dtiles";
  EXPECT_THAT(*written, testing::UnorderedElementsAre(folder + "/0_-1.json", folder + "/nodes/0_-1_2.glb",
                                                      folder + "/tileset.json"));
  EXPECT_EQ(ReadFile(folder + "/nodes/0_-1_2.glb").value(), "content of nodes/0_-1_2.glb");
  EXPECT_FALSE(fs::exists(folder + "/0_-1.zip"));
  EXPECT_FALSE(fs::exists(out_ + "/.fetch"));
}

TEST_F(ArtifactsTest, DamagedArchivesAndThoseThatLeadOutsideAreRefused) {
  std::string bytes = ZipOf(folder_.path(), {"a", "bb/evil"});
  for (size_t at = bytes.find("bb/evil"); at != std::string::npos; at = bytes.find("bb/evil"))
    bytes[at] = bytes[at + 1] = '.';
  AddArtifact("report.json", "{}");
  AddArtifact("export/obj/0_0.zip", bytes);
  EXPECT_EQ(Fetch().status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(fs::exists(out_ + "/export"));
  EXPECT_FALSE(fs::exists(out_ + "/report.json")) << "no file appears until all are complete";
  job_.mutable_artifacts()->RemoveLast();
  AddArtifact("export/obj/0_0.zip", bytes.substr(0, bytes.size() / 2));
  EXPECT_EQ(Fetch().status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(ArtifactsTest, PathsOutsideTheFolderAreRefused) {
  AddArtifact("../evil", "x");
  EXPECT_EQ(Fetch().status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(fs::exists(folder_.path() + "/evil"));
}

}  // namespace
}  // namespace tessera
