// PLY files as other programs write them: polygons, labels of other names, types and places, byte order marks, padding.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "common/meshio/mesh_format.h"
#include "common/meshio/ply.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// A text PLY, by its parts. Five vertices, as default.
struct PlyParts {
  std::vector<std::string> vertex_properties;  // after x, y, z
  std::vector<std::string> vertices = {"0 0 0", "1 0 0", "1 1 0", "0 1 0", "0.5 2 0"};
  std::vector<std::string> face_properties = {"list uchar int vertex_indices"};
  std::vector<std::string> faces = {"3 0 1 2"};

  std::string Text() const {
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(vertices.size()) +
                       "\nproperty double x\nproperty double y\nproperty double z\n";
    for (const std::string& property : vertex_properties) text += "property " + property + "\n";
    text += "element face " + std::to_string(faces.size()) + "\n";
    for (const std::string& property : face_properties) text += "property " + property + "\n";
    text += "end_header\n";
    for (const std::string& line : vertices) text += line + "\n";
    for (const std::string& line : faces) text += line + "\n";
    return text;
  }
};

// Little-endian values one after the other.
struct LittleEndian {
  std::string bytes;
  template <class Value>
  LittleEndian& Put(Value value) {
    char raw[sizeof(Value)];
    std::memcpy(raw, &value, sizeof(Value));
    bytes.append(raw, sizeof(Value));
    return *this;
  }
};

// Five vertices and faces with these numbers of vertices (0, 1, 2, ...) and labels.
std::string BinaryPly(const std::string& count_type, const std::string& label_type, const std::vector<int>& counts) {
  std::string header =
      "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty double x\nproperty double y\n"
      "property double z\nelement face " +
      std::to_string(counts.size()) + "\nproperty list " + count_type + " int vertex_indices\n";
  if (!label_type.empty()) header += "property " + label_type + " label\n";
  LittleEndian body;
  for (int v = 0; v < 5; ++v) body.Put(1.0 * v).Put(1.0 * v * v).Put(0.0);
  for (size_t f = 0; f < counts.size(); ++f) {
    if (count_type == "uchar") body.Put(static_cast<uint8_t>(counts[f]));
    if (count_type == "int") body.Put(static_cast<int32_t>(counts[f]));
    for (int k = 0; k < counts[f] && k < 2000; ++k) body.Put(static_cast<int32_t>(k % 5));
    if (label_type == "double") body.Put(1.0 * static_cast<double>(f));
    if (label_type == "float") body.Put(0.5f * static_cast<float>(f));
    if (label_type == "uint") body.Put(static_cast<uint32_t>(f));
  }
  return header + "end_header\n" + body.bytes;
}

struct Parsed {
  TriangleMesh mesh;
  Warnings warnings;
  std::string error;
};

Parsed ParseWithWarnings(const std::string& bytes, const std::optional<std::string>& label_property = {}) {
  Parsed parsed;
  StatusOr<MeshContent> content = ParsePly(bytes, "city.ply", {label_property, &parsed.warnings, "mesh.ply"});
  if (content.ok()) {
    parsed.mesh = std::move(content->mesh);
  } else {
    EXPECT_EQ(content.status().code(), absl::StatusCode::kInvalidArgument);
    parsed.error = std::string(content.status().message());
  }
  return parsed;
}

TEST(PlyPolygons, BecomeFansWithTheirLabels) {
  PlyParts ply;
  ply.face_properties = {"uchar red", "list uchar int vertex_indices", "list uchar float texcoord", "int label"};
  ply.faces = {"9 3 0 1 2 0 1", "9 4 0 1 2 3 2 0.5 0.5 2", "9 5 4 3 2 1 0 0 3"};
  const Parsed parsed = ParseWithWarnings(ply.Text());
  EXPECT_EQ(parsed.error, "");
  EXPECT_EQ(parsed.mesh.faces,
            (std::vector<Triangle>{{0, 1, 2}, {0, 1, 2}, {0, 2, 3}, {4, 3, 2}, {4, 2, 1}, {4, 1, 0}}));
  EXPECT_EQ(parsed.mesh.labels, (std::vector<int32_t>{1, 2, 2, 3, 3, 3}));
  EXPECT_THAT(parsed.warnings,
              ElementsAre("mesh.ply: 2 faces of more than 3 vertices split into 5 triangles (first: line 19)"));
}

TEST(PlyPolygons, OfBinaryFilesHaveTheirByte) {
  for (const char* const count_type : {"uchar", "int"}) {
    const std::string bytes = BinaryPly(count_type, "uint", {3, 5, 4});
    const Parsed parsed = ParseWithWarnings(bytes);
    EXPECT_EQ(parsed.error, "");
    EXPECT_EQ(parsed.mesh.faces,
              (std::vector<Triangle>{{0, 1, 2}, {0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 1, 2}, {0, 2, 3}}));
    EXPECT_EQ(parsed.mesh.labels, (std::vector<int32_t>{0, 1, 1, 1, 2, 2}));
    const size_t count_bytes = std::string(count_type) == "int" ? 4 : 1;
    const size_t first = bytes.find("end_header\n") + 11 + 5 * 24 + count_bytes + 3 * 4 + 4;
    EXPECT_THAT(parsed.warnings,
                ElementsAre("mesh.ply: 2 faces of more than 3 vertices split into 5 triangles (first: byte " +
                            std::to_string(first) + ")"));
  }
}

TEST(PlyPolygons, HaveThreeToAThousandVertices) {
  EXPECT_EQ(ParseWithWarnings(BinaryPly("int", "", {1000})).mesh.faces.size(), 998u);
  for (const int count : {-1, 0, 2, 1001, 2000000000}) {
    EXPECT_THAT(ParseWithWarnings(BinaryPly("int", "", {count})).error,
                HasSubstr("(face 0): found a face of " + std::to_string(count) + " vertices, expected 3 to 1000"));
    PlyParts ply;
    ply.faces = {std::to_string(count) + " 0 1"};
    EXPECT_THAT(ParseWithWarnings(ply.Text()).error,
                HasSubstr("line 15 (face 0): found a face of '" + std::to_string(count) + "' vertices"));
  }
}

TEST(PlyPolygons, AreCountedAsTriangles) {
  const std::string path = testing::TempDir() + "/polygons.ply";
  PlyParts text;
  text.faces = {"5 0 1 2 3 4", "3 0 1 2"};
  for (const std::string& bytes : {text.Text(), BinaryPly("uchar", "", {5, 3}), BinaryPly("uchar", "float", {5, 3})}) {
    std::ofstream(path, std::ios::binary) << bytes;
    for (const int64_t limit : {0, 1, 2, 3, 4, 100}) {
      const StatusOr<bool> more = HasMoreFaces(path, limit);
      ASSERT_TRUE(more.ok()) << more.status();
      EXPECT_EQ(*more, limit < 4) << limit;
    }
  }
}

TEST(PlyLabels, HaveAnyTypeOfNumber) {
  for (const char* const type : {"char", "uchar", "short", "ushort", "int", "uint", "float", "double"}) {
    PlyParts ply;
    ply.face_properties.push_back(std::string(type) + " label");
    ply.faces = {"3 0 1 2 3", "3 0 2 3 0"};
    const Parsed parsed = ParseWithWarnings(ply.Text());
    EXPECT_EQ(parsed.error, "") << type;
    EXPECT_EQ(parsed.mesh.labels, (std::vector<int32_t>{3, 0}));
    EXPECT_THAT(parsed.warnings, IsEmpty());
  }
  PlyParts ply;
  ply.face_properties.push_back("float label");
  ply.faces = {"3 0 1 2 3.000000", "3 0 2 3 -1.0", "3 0 2 3 2e0"};
  EXPECT_EQ(ParseWithWarnings(ply.Text()).mesh.labels, (std::vector<int32_t>{3, -1, 2}));
  EXPECT_EQ(ParseWithWarnings(BinaryPly("uchar", "double", {3, 3, 3})).mesh.labels, (std::vector<int32_t>{0, 1, 2}));
}

TEST(PlyLabels, AreWholeNumbers) {
  for (const char* const value : {"1.5", "nan", "inf", "-2", "3e9", "x"}) {
    PlyParts ply;
    ply.face_properties.push_back("float label");
    ply.faces = {"3 0 1 2 1", std::string("3 0 2 3 ") + value};
    EXPECT_EQ(ParseWithWarnings(ply.Text()).error,
              std::string("city.ply: line 17 (face 1): found label '") + value +
                  "', expected a class index (a whole number), or -1 for no label");
  }
  const std::string bytes = BinaryPly("uchar", "float", {3, 3});  // the second label is 0.5
  EXPECT_EQ(ParseWithWarnings(bytes).error,
            "city.ply: byte " + std::to_string(bytes.size() - 4) +
                " (face 1): found label 0.5, expected a class index (a whole number), or -1 for no label");
}

TEST(PlyLabels, ErrorsNameThePropertyIfItIsNotLabel) {
  PlyParts ply;
  ply.vertex_properties = {"float semantic"};
  for (std::string& vertex : ply.vertices) vertex += " 0.25";
  EXPECT_EQ(ParseWithWarnings(ply.Text()).error,
            "city.ply: line 11 (vertex 0): found label '0.25', expected a class index (a whole number), or -1 for no "
            "label; if 'semantic' holds no labels, set \"label_property\": null in scene.json");
  EXPECT_EQ(ParseWithWarnings(ply.Text(), "").error, "");
}

TEST(PlyLabels, HaveTheNamesOfOtherPrograms) {
  for (const char* const name : {"class", "category_id", "category", "classification", "scalar_label", "scalar_Label",
                                 "scalar_Classification", "semantic", "label_id", "labels", "Label", "CLASS"}) {
    PlyParts ply;
    ply.face_properties = {"list uchar int vertex_indices", std::string("int ") + name, "float quality"};
    ply.faces = {"3 0 1 2 2 0.5"};
    const Parsed parsed = ParseWithWarnings(ply.Text());
    EXPECT_EQ(parsed.mesh.labels, std::vector<int32_t>{2}) << name;
    EXPECT_THAT(parsed.warnings,
                ElementsAre(std::string("mesh.ply: labels are those of face property '") + name + "' (line 9)"));
    EXPECT_TRUE(HeadHasLabels(ply.Text()));
    EXPECT_FALSE(HeadHasLabels(ply.Text(), ""));
  }
}

TEST(PlyLabels, LabelComesFirst) {
  PlyParts ply;
  ply.vertex_properties = {"int label"};
  for (std::string& vertex : ply.vertices) vertex += " 0";
  ply.face_properties = {"int class", "list uchar int vertex_indices", "int label", "int Label", "int category"};
  ply.faces = {"7 3 0 1 2 2 8 9"};
  const Parsed parsed = ParseWithWarnings(ply.Text());
  EXPECT_EQ(parsed.mesh.labels, std::vector<int32_t>{2});
  EXPECT_THAT(parsed.warnings, IsEmpty());
}

TEST(PlyLabels, TwoCandidatesNeedTheOption) {
  PlyParts ply;
  ply.face_properties = {"list uchar int vertex_indices", "int class", "int category_id"};
  ply.faces = {"3 0 1 2 1 2"};
  EXPECT_EQ(
      ParseWithWarnings(ply.Text()).error,
      "city.ply: line 10: found face properties 'class' and 'category_id', which both may be the labels, expected "
      "the scene.json key \"label_property\" with the name of the one to use (null: none)");
  EXPECT_TRUE(HeadHasLabels(ply.Text()));
  const Parsed chosen = ParseWithWarnings(ply.Text(), "category_id");
  EXPECT_EQ(chosen.mesh.labels, std::vector<int32_t>{2});
  EXPECT_THAT(chosen.warnings, IsEmpty());
  EXPECT_THAT(ParseWithWarnings(ply.Text(), "").mesh.labels, IsEmpty());
}

TEST(PlyLabels, TheOptionNamesAPropertyOfFacesOrVertices) {
  PlyParts ply;
  ply.vertex_properties = {"uchar kind"};
  for (std::string& vertex : ply.vertices) vertex += " 3";
  ply.face_properties = {"list uchar int vertex_indices", "int sort", "int label"};
  ply.faces = {"3 0 1 2 1 2"};
  EXPECT_EQ(ParseWithWarnings(ply.Text(), "sort").mesh.labels, std::vector<int32_t>{1});
  EXPECT_EQ(ParseWithWarnings(ply.Text(), "kind").mesh.labels, std::vector<int32_t>{3});
  EXPECT_EQ(ParseWithWarnings(ply.Text(), "species").error,
            "city.ply: header: found no property 'species', which scene.json names in \"label_property\", expected one "
            "of 'kind', 'sort', 'label'");
  for (const char* const name : {"x", "vertex_indices"}) {
    EXPECT_THAT(ParseWithWarnings(ply.Text(), name).error,
                HasSubstr(std::string("found property '") + name + "', which scene.json names"));
  }
}

TEST(PlyLabels, OfVerticesGiveFacesTheirMajority) {
  PlyParts ply;
  ply.vertex_properties = {"float quality", "float scalar_Label"};
  const char* const labels[] = {"0", "1", "1", "2.0", "-1"};
  for (size_t v = 0; v < ply.vertices.size(); ++v) ply.vertices[v] += std::string(" 0.5 ") + labels[v];
  ply.faces = {"3 1 2 1", "3 0 1 2", "3 1 0 2", "3 1 2 3", "3 3 0 1", "4 4 0 1 2"};
  const std::vector<int32_t> expected = {1, 1, 1, 1, 2, -1, 1};
  const std::string text = ply.Text();
  const Parsed parsed = ParseWithWarnings(text);
  EXPECT_EQ(parsed.error, "");
  EXPECT_EQ(parsed.mesh.labels, expected);
  EXPECT_THAT(
      parsed.warnings,
      ElementsAre(
          "mesh.ply: 1 faces of more than 3 vertices split into 2 triangles (first: line 22)",
          "mesh.ply: labels are those of the vertices ('scalar_Label'): each face takes the label of most of its "
          "vertices; 6 faces have vertices of different labels (first: face 1)"));
  EXPECT_TRUE(HeadHasLabels(text));
  // Faces may come first.
  const size_t faces = text.find("element face"), end = text.find("end_header"), vertices = text.find("element vertex");
  const size_t body = end + 11, face_lines = text.find("3 1 2 1\n");
  const std::string turned = text.substr(0, vertices) + text.substr(faces, end - faces) +
                             text.substr(vertices, faces - vertices) + "end_header\n" + text.substr(face_lines) +
                             text.substr(body, face_lines - body);
  EXPECT_EQ(ParseWithWarnings(turned).mesh.labels, expected);
}

TEST(PlyLabels, HeadsMayBeCut) {
  PlyParts ply;
  ply.face_properties = {"list uchar int vertex_indices", "int label", "int other"};
  ply.faces = {"3 0 1 2 1 2"};
  const std::string text = ply.Text();
  const size_t declared = text.find("property int label\n") + std::string("property int label\n").size();
  for (size_t size = 0; size <= text.size(); ++size) {
    EXPECT_EQ(HeadHasLabels(text.substr(0, size)), size >= declared) << size;
  }
}

TEST(PlyEnvelope, AByteOrderMarkBeforeTextIsIgnored) {
  const std::string text = PlyParts().Text();
  const Parsed parsed = ParseWithWarnings("\xef\xbb\xbf" + text);
  EXPECT_EQ(parsed.error, "");
  EXPECT_EQ(parsed.mesh.faces.size(), 1u);
  EXPECT_THAT(parsed.warnings, ElementsAre("mesh.ply: a byte order mark before the header ignored"));
  EXPECT_TRUE(IsPly("\xef\xbb\xbf" + text));
  EXPECT_THAT(ParseWithWarnings("\xef\xbb\xbf" + BinaryPly("uchar", "", {3})).error,
              HasSubstr("line 2: found a byte order mark before a binary PLY, expected none: a text editor"));
}

TEST(PlyEnvelope, AFewBytesAfterTheLastElementAreIgnored) {
  const std::string text = PlyParts().Text(), binary = BinaryPly("uchar", "", {3});
  const std::string place = "(byte " + std::to_string(binary.size()) + ")";
  EXPECT_THAT(ParseWithWarnings(binary + "\n").warnings,
              ElementsAre("mesh.ply: 1 byte after the last element ignored " + place));
  EXPECT_THAT(ParseWithWarnings(binary + std::string(16, '\0')).warnings,
              ElementsAre("mesh.ply: 16 bytes after the last element ignored " + place));
  EXPECT_THAT(ParseWithWarnings(text + "\n\n" + std::string(3, '\0')).warnings,
              ElementsAre("mesh.ply: 3 bytes after the last element ignored (line 18)"));
  EXPECT_THAT(ParseWithWarnings(text + std::string(100, '\n')).warnings, IsEmpty());
  EXPECT_THAT(ParseWithWarnings(binary + std::string(17, '\0')).error,
              AllOf(HasSubstr("found 17 bytes after the last element, expected the end of the file"),
                    HasSubstr("byte " + std::to_string(binary.size()))));
  EXPECT_THAT(ParseWithWarnings(text + "3 0 1 2\n3 0 1 2\n3 0 1 2\n").error,
              HasSubstr("line 16: found 24 bytes after the last element"));
}

// Files without anything unusual have no warnings, also with CRLF line ends.
TEST(PlyEnvelope, UsualFilesHaveNoWarnings) {
  std::string crlf;
  for (const char c : PlyParts().Text()) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
  for (const std::string& bytes : {PlyParts().Text(), crlf, BinaryPly("uchar", "uint", {3, 3})}) {
    const Parsed parsed = ParseWithWarnings(bytes);
    EXPECT_EQ(parsed.error, "");
    EXPECT_THAT(parsed.warnings, IsEmpty());
  }
}

}  // namespace
}  // namespace tessera
