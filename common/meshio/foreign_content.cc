#include "common/meshio/foreign_content.h"

#include <cstring>
#include <initializer_list>

namespace tessera {
namespace {

constexpr char kConvert[] = "convert it, for example with MeshLab, Blender or CloudCompare";
constexpr char kExport[] = "export the mesh as OBJ, GLB or PLY from the program that made it";
constexpr char kMeshFirst[] = "it has points; build a mesh from them first";
constexpr char kUnpack[] = "unpack it";
constexpr char kDownload[] = "download the file again";

struct Signature {
  std::string_view begins;  // the first bytes
  ForeignKind kind;
  const char* name;
  const char* remedy;
};

constexpr Signature kSignatures[] = {
    {"version https://git-lfs.github.com/spec/", ForeignKind::kOther, "a Git LFS pointer in place of the file",
     "run 'git lfs pull'"},
    {"LASF", ForeignKind::kPoints, "a point cloud (LAS or LAZ)", kMeshFirst},
    {"# .PCD", ForeignKind::kPoints, "a point cloud (PCD)", kMeshFirst},
    {"ASTM-E57", ForeignKind::kPoints, "a point cloud (E57)", kMeshFirst},
    {"Kaydara FBX Binary", ForeignKind::kMesh, "an FBX file", kConvert},
    {"; FBX ", ForeignKind::kMesh, "an FBX file", kConvert},
    {"DRACO", ForeignKind::kMesh, "a mesh that is compressed with Draco", "decompress it"},
    {"PK\x03\x04", ForeignKind::kPacked, "a ZIP archive", kUnpack},
    {"\x1f\x8b", ForeignKind::kPacked, "a gzip file", kUnpack},
    {"7z\xbc\xaf\x27\x1c", ForeignKind::kPacked, "a 7z archive", kUnpack},
    {"<!DOCTYPE html", ForeignKind::kOther, "a web page", kDownload},
    {"<!doctype html", ForeignKind::kOther, "a web page", kDownload},
    {"<html", ForeignKind::kOther, "a web page", kDownload},
    {"b3dm", ForeignKind::kMesh, "a tile of 3D Tiles (B3DM)", kExport},
    {"i3dm", ForeignKind::kMesh, "a tile of 3D Tiles (I3DM)", kExport},
    {"cmpt", ForeignKind::kMesh, "a tile of 3D Tiles (CMPT)", kExport},
    {"3MXBO", ForeignKind::kCaptureMesh, "a tile of 3MX", kExport},
    {"\xa1\x0e\x91\x6c\x45\x45\xfb\x1a", ForeignKind::kCaptureMesh, "an OSGB file", kExport},
    {"\x1a\xfb\x45\x45\x6c\x91\x0e\xa1", ForeignKind::kCaptureMesh, "an OSGB file", kExport},
    {"<?xml", ForeignKind::kXml, "an XML file", kConvert},
};

// The first word of a text.
std::string_view FirstWord(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_first_of(kBlanks, begin) - begin);
}

// 80 bytes of any text, the number of triangles, 50 bytes per triangle.
bool IsBinaryStl(std::string_view head, int64_t size_bytes) {
  constexpr size_t kCountAt = 80;
  uint32_t count = 0;
  if (head.size() < kCountAt + sizeof(count)) return false;
  std::memcpy(&count, head.data() + kCountAt, sizeof(count));
  return size_bytes == static_cast<int64_t>(kCountAt + sizeof(count)) + 50 * static_cast<int64_t>(count);
}

}  // namespace

std::optional<ForeignContent> RecogniseForeignContent(std::string_view head, int64_t size_bytes) {
  constexpr auto kMesh = ForeignKind::kMesh;
  if (head.starts_with("<?xml") && head.find("<COLLADA") != std::string_view::npos) {
    return ForeignContent{kMesh, "a COLLADA file (DAE)", kExport};
  }
  for (const Signature& signature : kSignatures) {
    if (head.starts_with(signature.begins)) return ForeignContent{signature.kind, signature.name, signature.remedy};
  }
  const std::string_view word = FirstWord(head);
  for (const std::string_view off : {"OFF", "COFF", "NOFF", "STOFF", "CNOFF", "4OFF", "nOFF"}) {
    if (word == off) return ForeignContent{kMesh, "an OFF file", kConvert};
  }
  if (word == "solid" && head.find("facet") != std::string_view::npos)
    return ForeignContent{kMesh, "a text STL file", kConvert};
  if (IsBinaryStl(head, size_bytes)) return ForeignContent{kMesh, "a binary STL file", kConvert};
  return {};
}

}  // namespace tessera
