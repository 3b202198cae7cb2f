#include "common/meshio/ply.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>

#include "common/base/random.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TriangleMesh Tetrahedron() {
  TriangleMesh mesh;
  mesh.vertices = {{0.5, 0, 0}, {1, 0, 0.25}, {0, 1, -3}, {0, 0, 1e6}};
  mesh.faces = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  mesh.labels = {0, 3, -1, 2};
  return mesh;
}

// Appends a value of any type in either byte order.
class Bytes {
 public:
  explicit Bytes(bool big_endian) : big_endian_(big_endian) {}
  template <class Value>
  Bytes& Put(Value value) {
    char raw[sizeof(Value)];
    std::memcpy(raw, &value, sizeof(Value));
    if (big_endian_) std::reverse(raw, raw + sizeof(Value));
    bytes_.append(raw, sizeof(Value));
    return *this;
  }
  const std::string& str() const { return bytes_; }

 private:
  bool big_endian_;
  std::string bytes_;
};

constexpr char kHeader[] =
    "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n";

// The data of kHeader.
std::string OneFace(float z, uint8_t corners, int32_t last) {
  Bytes data(false);
  for (float value : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, z}) data.Put(value);
  data.Put(corners).Put(int32_t{0}).Put(int32_t{1}).Put(last);
  return data.str();
}

constexpr char kTextHeader[] =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n";

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string ErrorOf(const std::string& bytes) {
  const StatusOr<MeshContent> content = ParsePly(bytes, "city.ply");
  EXPECT_FALSE(content.ok());
  EXPECT_EQ(content.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(content.status().message());
}

TEST(Ply, RoundTrip) {
  const std::string path = testing::TempDir() + "/roundtrip.ply";
  const TriangleMesh mesh = Tetrahedron();
  PlyWriteOptions options;
  options.label_colors_rgb = {{1, 2, 3}, {4, 5, 6}};
  options.face_confidence = {0, 0.5, 1, 0.25};
  ASSERT_TRUE(WritePly(path, mesh, options).ok());
  const StatusOr<MeshContent> read = ReadPly(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.vertices, mesh.vertices);
  EXPECT_EQ(read->mesh.faces, mesh.faces);
  EXPECT_EQ(read->mesh.labels, mesh.labels);
  EXPECT_FALSE(read->float_positions);
}

// Larger than the reader's window and the writer's buffer.
TEST(Ply, ReadsFilesLargerThanTheWindow) {
  const std::string path = testing::TempDir() + "/large.ply";
  Random random(5);
  TriangleMesh mesh;
  for (int i = 0; i < 60000; ++i) mesh.vertices.push_back({random.Normal(), random.Normal(), random.Normal()});
  for (int i = 0; i < 120000; ++i) {
    Triangle face;
    for (uint32_t& corner : face) corner = static_cast<uint32_t>(random.Below(60000));
    mesh.faces.push_back(face);
  }
  ASSERT_TRUE(WritePly(path, mesh).ok());
  const StatusOr<MeshContent> read = ReadPly(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.vertices, mesh.vertices);
  EXPECT_EQ(read->mesh.faces, mesh.faces);
  EXPECT_TRUE(read->mesh.labels.empty());

  // The same as text, through a file and from memory.
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 60000\nproperty double x\nproperty double y\n"
      "property double z\nelement face 120000\nproperty list uchar int vertex_index\nend_header\n";
  char line[120];
  for (const Eigen::Vector3d& v : mesh.vertices) {
    std::snprintf(line, sizeof(line), "%.17g %.17g %.17g\n", v.x(), v.y(), v.z());
    text += line;
  }
  for (const Triangle& f : mesh.faces) {
    std::snprintf(line, sizeof(line), "3 %u %u %u\n", f[0], f[1], f[2]);
    text += line;
  }
  std::ofstream(path, std::ios::binary) << text;
  for (const StatusOr<MeshContent>& content : {ReadPly(path), ParsePly(text, "text")}) {
    ASSERT_TRUE(content.ok()) << content.status();
    EXPECT_EQ(content->mesh.vertices, mesh.vertices);
    EXPECT_EQ(content->mesh.faces, mesh.faces);
  }
}

TEST(Ply, WritingIsAtomicAndLeavesNoTemporaryFile) {
  const std::string folder = testing::TempDir() + "/ply_atomic";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directory(folder);
  std::ofstream(folder + "/a.ply") << "old";
  ASSERT_TRUE(WritePly(folder + "/a.ply", Tetrahedron()).ok());
  EXPECT_TRUE(ReadPly(folder + "/a.ply").ok());
  TriangleMesh broken = Tetrahedron();
  broken.vertices[1].y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(WritePly(folder + "/a.ply", broken).ok());
  broken = Tetrahedron();
  broken.labels.pop_back();
  EXPECT_FALSE(WritePly(folder + "/a.ply", broken).ok());
  EXPECT_TRUE(ReadPly(folder + "/a.ply").ok());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);
  EXPECT_EQ(WritePly(folder + "/no/such/folder.ply", Tetrahedron()).code(), absl::StatusCode::kNotFound);
}

TEST(Ply, MissingFilesAreNotFound) {
  EXPECT_EQ(ReadPly(testing::TempDir() + "/nowhere.ply").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReadPly(testing::TempDir()).status().code(), absl::StatusCode::kInvalidArgument);
}

// All number types, other elements before, between and after, and other properties and lists.
TEST(Ply, SkipsOtherElementsAndProperties) {
  for (const bool big : {false, true}) {
    const std::string header = std::string("ply\r\ncomment made by hand\r\nformat ") +
                               (big ? "binary_big_endian" : "binary_little_endian") +
                               " 1.0\r\nobj_info x\r\nelement camera 2\r\nproperty double f\r\nproperty char c\r\n"
                               "element strip 1\r\nproperty list int ushort items\r\nproperty int8 end\r\n"
                               "element nothing 7000000000\r\n"
                               "element vertex 3\r\nproperty uchar red\r\nproperty short x\r\nproperty uint8 green\r\n"
                               "property float64 y\r\nproperty list uint8 float uv\r\nproperty float32 z\r\n"
                               "property float quality\r\n"
                               "element face 2\r\nproperty list char double texcoord\r\nproperty uint16 label\r\n"
                               "property list int uchar vertex_index\r\nproperty float confidence\r\n"
                               "element edge 1\r\nproperty int a\r\nproperty list uint uint b\r\nend_header\r\n";
    Bytes data(big);
    for (int i = 0; i < 2; ++i) data.Put(1.5).Put(int8_t{3});
    data.Put(int32_t{2}).Put(uint16_t{7}).Put(uint16_t{8}).Put(int8_t{-1});
    for (int16_t i = 0; i < 3; ++i) {
      data.Put(uint8_t{200}).Put(static_cast<int16_t>(-300 - i)).Put(uint8_t{1}).Put(0.125 * i);
      data.Put(static_cast<uint8_t>(i));
      for (int k = 0; k < i; ++k) data.Put(std::numeric_limits<float>::quiet_NaN());
      data.Put(2.5f).Put(0.f);
    }
    for (uint16_t label : {7, 65535}) {
      data.Put(int8_t{1}).Put(0.5).Put(label).Put(int32_t{3});
      data.Put(uint8_t{2}).Put(uint8_t{1}).Put(uint8_t{0}).Put(1.f);
    }
    data.Put(int32_t{0}).Put(uint32_t{1}).Put(uint32_t{9});
    const StatusOr<MeshContent> content = ParsePly(header + data.str(), "other");
    ASSERT_TRUE(content.ok()) << content.status();
    const TriangleMesh& mesh = content->mesh;
    ASSERT_EQ(mesh.vertices.size(), 3u);
    EXPECT_EQ(mesh.vertices[2], Eigen::Vector3d(-302, 0.25, 2.5));
    EXPECT_EQ(mesh.faces, (std::vector<Triangle>{{2, 1, 0}, {2, 1, 0}}));
    EXPECT_EQ(mesh.labels, (std::vector<int32_t>{7, 65535}));
    EXPECT_TRUE(content->float_positions);
  }
}

TEST(Ply, ReadsTextWithAllFeatures) {
  const StatusOr<MeshContent> content = ParsePly(
      "ply\nformat ascii 1.0\ncomment VCGLIB generated\nelement face 1\nproperty list uchar int vertex_indices\n"
      "property list uchar float texcoord\nproperty int label\nelement vertex 3\nproperty float x\nproperty double y\n"
      "property int z\nproperty uchar red\nelement none 3\nelement edge 1\nproperty int a\nend_header\n"
      "3 0 1 2 2 0.5 nan -1\r\n\n  1e-400 +2.5  -7 255 \n-.5\t3. 8 0\n1e3 0x 0 0\n5\n\n",
      "text");
  // "0x" is not a number.
  EXPECT_THAT(content.status().message(), HasSubstr("text: line 21 (vertex 2): found y = '0x', expected a finite"));
  const StatusOr<MeshContent> good = ParsePly(
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
      "property list uchar float texcoord\nproperty int label\nelement vertex 3\nproperty float x\nproperty double y\n"
      "property int z\nproperty uchar red\nelement none 3\nelement edge 1\nproperty int a\nend_header\n"
      "3 0 1 2 2 0.5 nan -1\r\n\n  1e-400 +2.5  -7 255 \n-.5\t3. 8 0\n1e3 0 0 0\n5",
      "text");
  ASSERT_TRUE(good.ok()) << good.status();
  EXPECT_EQ(good->mesh.vertices, (std::vector<Eigen::Vector3d>{{0, 2.5, -7}, {-0.5, 3, 8}, {1000, 0, 0}}));
  EXPECT_EQ(good->mesh.labels, std::vector<int32_t>{-1});
}

TEST(Ply, HeaderFaults) {
  const std::string good = kTextHeader + std::string("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 4\n");
  ASSERT_TRUE(ParsePly(good, "good").ok());
  const auto error = [&](const std::string& from, const std::string& to) { return ErrorOf(Replaced(good, from, to)); };
  EXPECT_EQ(ErrorOf(""), "city.ply: line 1: found the end of the file, expected 'ply'");
  EXPECT_EQ(error("ply", "obj"), "city.ply: line 1: found 'obj', expected 'ply'");
  EXPECT_EQ(ErrorOf("ply\n"), "city.ply: line 2: found the end of the file, expected 'end_header'");
  EXPECT_THAT(ErrorOf("ply\ncomment " + std::string(100000, 'x')), HasSubstr("line 2: found a line too long"));
  EXPECT_THAT(error("format ascii 1.0\n", ""),
              HasSubstr("line 2: found 'element vertex 3', expected the line 'format"));
  EXPECT_THAT(error("ascii", "binary\x01"), HasSubstr("line 2: found format 'binary\\x01', expected ascii, "));
  EXPECT_THAT(error("1.0", "2.0"), HasSubstr("line 2: found version '2.0', expected 1.0"));
  EXPECT_THAT(error("ascii", ""), HasSubstr("line 2: found a format of 2 words"));
  EXPECT_THAT(error("1.0\n", "1.0\nformat ascii 1.0\n"), HasSubstr("line 3: found a second format"));
  EXPECT_THAT(error("end_header", "endheader"), HasSubstr("line 10: found 'endheader', expected format, "));
  EXPECT_THAT(error("end_header", "end_header now"), HasSubstr("line 10: found 'end_header now'"));
  EXPECT_THAT(error("element", "\nelement"), HasSubstr("line 3: found an empty line"));
  EXPECT_THAT(error("vertex 3", "vertex -3"), HasSubstr("line 3: found count '-3', expected an integer"));
  EXPECT_THAT(error("vertex 3", "vertex 3.5"), HasSubstr("line 3: found count '3.5'"));
  EXPECT_THAT(error("vertex 3", "vertex 99999999999999999999"), HasSubstr("line 3: found count '9999"));
  EXPECT_THAT(error("vertex 3", "vertex"), HasSubstr("line 3: found an element of 2 words"));
  EXPECT_THAT(error("vertex 3", "vertex 5000000000"), HasSubstr("line 3: found 5000000000 vertices"));
  EXPECT_THAT(error("vertex 3", "vertex 4000000000"),
              AllOf(HasSubstr("line 3: found 4000000000 elements 'vertex' declared, 28 bytes after the header"),
                    HasSubstr("at least 23999999999 bytes")));
  EXPECT_THAT(error("face 1", "face 9223372036854775807"), HasSubstr("line 7: found 9223372036854775807 elements"));
  EXPECT_THAT(error("face 1", "vertex 1"), HasSubstr("line 7: found a second element 'vertex'"));
  EXPECT_THAT(error("element vertex 3\n", ""), HasSubstr("line 3: found a property before any element"));
  EXPECT_THAT(error("element vertex", "element point"), HasSubstr("found no element 'vertex'"));
  EXPECT_THAT(error("element face", "element triangle"), HasSubstr("found no element 'face'"));
  EXPECT_THAT(error("float x", "half x"), HasSubstr("line 4: found type 'half'"));
  EXPECT_THAT(error("float x", "float"), HasSubstr("line 4: found a property of 2 words"));
  EXPECT_THAT(error("float y", "float x"), HasSubstr("line 5: found a second property 'x' of element 'vertex'"));
  EXPECT_THAT(error("float x", "list uchar float x"), HasSubstr("line 4: found a list 'x', expected a number"));
  for (const char* axis : {"x", "y", "z"}) {
    EXPECT_THAT(error(std::string("float ") + axis, "float w"),
                HasSubstr(std::string("line 3: found vertices without property '") + axis + "'"));
  }
  const std::string longest(100, 'n'), longer(101, 'n');
  EXPECT_TRUE(ParsePly(Replaced(good, "element vertex", "element " + longest + " 0\nelement vertex"), "long").ok());
  EXPECT_THAT(error("element vertex", "element " + longer + " 0\nelement vertex"),
              HasSubstr("line 3: found a name of 101 bytes: 'nnn"));
  EXPECT_THAT(error("int label", "int " + longer), HasSubstr("line 9: found a name of 101 bytes"));
  EXPECT_THAT(error("vertex_indices", "indices"), HasSubstr("line 7: found faces without a list 'vertex_indices'"));
  EXPECT_THAT(error("list uchar int", "int"),
              HasSubstr("line 8: found face property 'vertex_indices' that is not a list"));
  EXPECT_THAT(error("list uchar int", "list uchar float"), HasSubstr("line 8: found face property 'vertex_indices'"));
  EXPECT_THAT(error("list uchar", "list float"), HasSubstr("line 8: found list count type 'float'"));
  EXPECT_THAT(error("int label", "list uchar int label"),
              HasSubstr("line 9: found face property 'label' that is a list, expected 'property int label'"));
  EXPECT_THAT(error("property int label", "property list uchar int vertex_index"),
              HasSubstr("line 9: found both vertex_indices and vertex_index"));
}

TEST(Ply, TextFaults) {
  const std::string header = kTextHeader;
  const auto error = [&](const std::string& data) { return ErrorOf(header + data); };
  EXPECT_EQ(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 3 4\n"),
            "city.ply: line 14 (face 0): found vertex index '3', expected an index below 3");
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 -1 2 4\n"), HasSubstr("line 14 (face 0): found vertex index '-1'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1.0 2 4\n"), HasSubstr("line 14 (face 0): found vertex index '1.0'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n2 0 1 4\n"),
              HasSubstr("line 14 (face 0): found a face of '2' vertices, expected 3 to 1000 vertices"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n-3 0 1 2 4\n"), HasSubstr("found a face of '-3' vertices, expected 3"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n1001 0 1 2 4\n"), HasSubstr("found a face of '1001' vertices, expected 3"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n"), HasSubstr("found the end of the line, expected a vertex index"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 -2\n"), HasSubstr("line 14 (face 0): found label '-2'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 3000000000\n"), HasSubstr("found label '3000000000'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n\n\n"), HasSubstr("line 14 (face 0): found the end of the line"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1\n\n\n\n"), HasSubstr("line 14 (face 0): found the end of the line"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 4 5\n"), HasSubstr("line 14 (face 0): found extra text '5'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0 0 0 0 0 0 0\n"), HasSubstr("line 13 (vertex 2): found extra text '0 0"));
  EXPECT_THAT(error("0 0 0\n1 nan 0\n0 1 0\n3 0 1 2 4\n"),
              HasSubstr("line 12 (vertex 1): found y = 'nan', expected a finite number"));
  EXPECT_THAT(error("0 0 0\n1 0 -inf\n0 1 0\n3 0 1 2 4\n"), HasSubstr("line 12 (vertex 1): found z = '-inf'"));
  EXPECT_THAT(error("0 0 0\n1 0 1e999\n0 1 0\n3 0 1 2 4\n"), HasSubstr("line 12 (vertex 1): found z = '1e999'"));
  EXPECT_THAT(error("0 0 0\n1 0 1,5\n0 1 0\n3 0 1 2 4\n"), HasSubstr("line 12 (vertex 1): found z = '1,5'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n\n\n\n\n\n\n"),
              HasSubstr("line 20 (face 0): found the end of the file, expected 1 elements 'face'"));
  EXPECT_THAT(error("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 4\n\n7 7 7 7 7 7 7 7 7\n"),
              HasSubstr("line 16: found 18 bytes after the last element, expected the end of the f"));
  const std::string list = Replaced(header, "property int label", "property list int int extra");
  EXPECT_THAT(ErrorOf(list + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 -1\n"), HasSubstr("found a list 'extra' of '-1' values"));
  EXPECT_THAT(ErrorOf(list + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 2 7\n"), HasSubstr("found a list 'extra' of 1 values"));
}

TEST(Ply, BinaryFaults) {
  const std::string header = kHeader;
  const std::string start = "city.ply: byte " + std::to_string(header.size() + 36) + " (face 0): ";
  ASSERT_TRUE(ParsePly(header + OneFace(0, 3, 2), "good").ok());
  EXPECT_EQ(ErrorOf(header + OneFace(0, 3, 3)), start + "found vertex index 3, expected an index below 3");
  EXPECT_EQ(ErrorOf(header + OneFace(0, 3, -1)), start + "found vertex index -1, expected an index below 3");
  EXPECT_EQ(ErrorOf(header + OneFace(0, 2, 2)), start + "found a face of 2 vertices, expected 3 to 1000 vertices");
  EXPECT_THAT(ErrorOf(header + OneFace(0, 4, 2)), HasSubstr("(face 0): found the end of the file"));
  EXPECT_THAT(ErrorOf(Replaced(header, "uchar int", "char int") + OneFace(0, 255, 2)),
              HasSubstr("(face 0): found a face of -1 vertices, expected 3"));
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    EXPECT_THAT(ErrorOf(header + OneFace(bad, 3, 2)),
                AllOf(HasSubstr("byte " + std::to_string(header.size() + 32) + " (vertex 2): found z = "),
                      HasSubstr(", expected a finite number")));
  }
  const std::string whole = header + OneFace(0, 3, 2);
  EXPECT_EQ(ErrorOf(whole + std::string(17, '\n')),
            "city.ply: byte " + std::to_string(whole.size()) +
                ": found 17 bytes after the last element, expected the end of the file");
  // A file truncated at any byte is rejected.
  for (size_t size = 0; size < whole.size(); ++size) ErrorOf(whole.substr(0, size));
  EXPECT_EQ(
      ErrorOf(whole.substr(0, whole.size() - 1)),
      start + "found the end of the file (" + std::to_string(whole.size() - 1) + " bytes), expected 1 elements 'face'");
  const std::string labelled = Replaced(header, "end_header", "property int label\nend_header");
  EXPECT_THAT(ErrorOf(labelled + Bytes(false).Put('x').str() + OneFace(0, 3, 2)), HasSubstr("found"));
  EXPECT_THAT(ErrorOf(labelled + OneFace(0, 3, 2) + Bytes(false).Put(int32_t{-2}).str()),
              HasSubstr("(face 0): found label -2, expected a class index"));
  const std::string lists = Replaced(header, "end_header", "property list int double more\nend_header");
  EXPECT_THAT(ErrorOf(lists + OneFace(0, 3, 2) + Bytes(false).Put(int32_t{-5}).str()),
              HasSubstr("(face 0): found a list 'more' of -5 values"));
  EXPECT_THAT(ErrorOf(lists + OneFace(0, 3, 2) + Bytes(false).Put(int32_t{2000000000}).str()),
              HasSubstr("found the end of the file"));
}

TEST(Ply, AbsurdCountsAreRefusedBeforeAllocation) {
  EXPECT_THAT(ErrorOf(Replaced(kHeader, "vertex 3", "vertex 4294967295") + OneFace(0, 3, 2)),
              HasSubstr("line 3: found 4294967295 elements 'vertex' declared, 49 bytes after the header"));
  EXPECT_THAT(ErrorOf(Replaced(kHeader, "face 1", "face 9223372036854775807") + OneFace(0, 3, 2)),
              HasSubstr("line 7: found 9223372036854775807 elements 'face' declared"));
}

TEST(PlyStream, AppearsOnlyWithTheAnnouncedCounts) {
  const std::string path = testing::TempDir() + "/streamed.ply";
  std::filesystem::remove(path);
  PlyLayout layout;
  layout.vertices = 3;
  layout.faces = 1;
  for (const int vertices : {2, 3}) {
    auto stream = PlyStream::Create(path, layout);
    ASSERT_TRUE(stream.ok()) << stream.status();
    for (int v = 0; v < vertices; ++v) stream->AddVertex({0.5 * v, 1.0 * v * v, -1});
    stream->AddFace({{0, 1, 2}});
    EXPECT_EQ(stream->Finish().ok(), vertices == 3);
    EXPECT_EQ(std::filesystem::exists(path), vertices == 3);
  }
  const auto read = ReadPly(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.vertices[2], Eigen::Vector3d(1, 4, -1));
  EXPECT_FALSE(*PlyHasMoreFaces(path, 1));
  EXPECT_TRUE(*PlyHasMoreFaces(path, 0));
}

TEST(PlyStream, OutdatedFacesHaveAByte) {
  const std::string path = testing::TempDir() + "/outdated.ply";
  PlyLayout layout;
  layout.vertices = 3;
  layout.faces = 2;
  layout.has_outdated = true;
  auto stream = PlyStream::Create(path, layout);
  ASSERT_TRUE(stream.ok()) << stream.status();
  for (int v = 0; v < 3; ++v) stream->AddVertex({0.5 * v, 1.0 * v * v, -1});
  PlyFace face = {{0, 1, 2}};
  stream->AddFace(face);
  face.outdated = true;
  stream->AddFace(face);
  ASSERT_TRUE(stream->Finish().ok());
  std::ifstream file(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  EXPECT_THAT(bytes, HasSubstr("property list uchar int vertex_indices\nproperty uchar outdated\nend_header\n"));
  EXPECT_EQ(bytes.back(), 1);
  EXPECT_EQ(bytes[bytes.size() - 1 - 14], 0);  // a face: a byte, three indices, a byte
  EXPECT_EQ(ReadPly(path)->mesh.faces.size(), 2u) << "it is read past";
}

}  // namespace
}  // namespace tessera
