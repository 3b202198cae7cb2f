// The property `confidence` of faces, which readers give on demand.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/meshio/ply.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::ElementsAre;

// Keeps the confidence of each triangle; -1 if none was given.
struct ConfidenceSink : MeshSink {
  Status Begin(const MeshLayout& layout) override {
    has_confidence = layout.has_confidence;
    label_property = layout.label_property;
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d&, int32_t) override {}
  void SetConfidence(float value) override { next = value; }
  void AddFace(const Triangle&, int32_t) override { confidence.push_back(next); }
  bool has_confidence = false;
  std::string label_property;
  float next = -1;
  std::vector<float> confidence;
};

class PlyConfidenceTest : public testing::Test {
 protected:
  ConfidenceSink Read(const MeshReadOptions& options) {
    ConfidenceSink sink;
    const Status status = StreamPly(path_, options, &sink);
    EXPECT_TRUE(status.ok()) << status;
    return sink;
  }
  void WriteAscii(const std::string& properties, const std::string& faces) {
    ASSERT_TRUE(WriteFileAtomic(path_,
                                "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
                                "property double z\nelement face 2\nproperty list uchar int vertex_indices\n" +
                                    properties + "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n" + faces)
                    .ok());
  }
  static MeshReadOptions WithConfidence() {
    MeshReadOptions options;
    options.confidence = true;
    return options;
  }

  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  const std::string path_ = folder_.path() + "/mesh.ply";
};

TEST_F(PlyConfidenceTest, IsThatOfTheFacesOfOurMeshes) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  mesh.labels = {1, 0};
  PlyWriteOptions write;
  write.label_colors_rgb = {{1, 2, 3}, {4, 5, 6}};
  write.face_confidence = {0.25f, 0.75f};
  write.input_face = {7, 8};
  ASSERT_TRUE(WritePly(path_, mesh, write).ok());
  const ConfidenceSink sink = Read(WithConfidence());
  EXPECT_TRUE(sink.has_confidence);
  EXPECT_EQ(sink.label_property, "label");
  EXPECT_THAT(sink.confidence, ElementsAre(0.25f, 0.75f));
  const ConfidenceSink not_asked = Read({});
  EXPECT_FALSE(not_asked.has_confidence);
  EXPECT_THAT(not_asked.confidence, ElementsAre(-1, -1));
}

TEST_F(PlyConfidenceTest, AllTrianglesOfAFaceHaveItsConfidence) {
  WriteAscii("property float confidence\nproperty uchar other\n", "4 0 1 2 3 0.5 9\n3 0 1 2 0.125 9\n");
  const ConfidenceSink sink = Read(WithConfidence());
  EXPECT_THAT(sink.confidence, ElementsAre(0.5f, 0.5f, 0.125f));
}

TEST_F(PlyConfidenceTest, OtherPropertiesOfThatNameAreNone) {
  WriteAscii("property list uchar float confidence\n", "3 0 1 2 1 0.5\n3 0 2 3 0\n");
  EXPECT_FALSE(Read(WithConfidence()).has_confidence);
  WriteAscii("property int confidence\n", "3 0 1 2 1\n3 0 2 3 2\n");
  MeshReadOptions labels = WithConfidence();
  labels.label_property = "confidence";
  const ConfidenceSink sink = Read(labels);
  EXPECT_FALSE(sink.has_confidence) << "it holds the labels";
  EXPECT_EQ(sink.label_property, "confidence");
}

TEST_F(PlyConfidenceTest, TextThatIsNoNumberIsAnError) {
  WriteAscii("property float confidence\n", "3 0 1 2 high\n3 0 2 3 1\n");
  ConfidenceSink sink;
  EXPECT_THAT(std::string(StreamPly(path_, WithConfidence(), &sink).message()),
              testing::HasSubstr("line 15 (face 0): found confidence"));
}

}  // namespace
}  // namespace tessera
