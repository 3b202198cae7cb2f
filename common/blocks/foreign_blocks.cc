#include "common/blocks/foreign_blocks.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr char kForeignMesh[] = "the block with its cameras as SOURCE, and the mesh as OBJ, GLB or PLY with --mesh";
constexpr char kForeignCapture[] =
    "in iTwin Capture (ContextCapture), the block exported as BlocksExchange XML as SOURCE, and a production in OBJ "
    "format with --mesh";
constexpr char kForeignMeshroom[] =
    "in Meshroom, the model that the node ExportColmap writes, or the program aliceVision_exportColmap";
constexpr char kForeignMicMac[] = "in MicMac, an NVM file: mm3d Apero2NVM";
constexpr char kForeignBundler[] =
    "the adjusted block in a format with image sizes and principal points: for OpenDroneMap its project folder, for "
    "Metashape the cameras as XML, for Pix4D its params folder, for RealityScan XMP or CSV, else a COLMAP model";
constexpr char kForeignPoints[] = "the block with its cameras as SOURCE; a mesh, not points, with --mesh";
constexpr char kForeignUnpack[] = "its content: unpack it";

struct ForeignSignature {
  std::string_view begins;  // the first bytes
  const char* name;
  const char* remedy;
};

constexpr ForeignSignature kForeignSignatures[] = {
    {"# Bundle file", "a Bundler file", kForeignBundler},
    {"\xa1\x0e\x91\x6c\x45\x45\xfb\x1a", "an OpenSceneGraph mesh (OSGB)", kForeignCapture},
    {"\x1a\xfb\x45\x45\x6c\x91\x0e\xa1", "an OpenSceneGraph mesh (OSGB)", kForeignCapture},
    {"3MXBO", "a 3MX mesh (3mxb)", kForeignCapture},
    {"b3dm", "a tile of 3D Tiles (b3dm)", kForeignMesh},
    {"i3dm", "a tile of 3D Tiles (i3dm)", kForeignMesh},
    {"cmpt", "a tile of 3D Tiles (cmpt)", kForeignMesh},
    {"glTF", "a mesh (GLB)", kForeignMesh},
    {"ply\n", "a mesh or point cloud (PLY)", kForeignMesh},
    {"ply\r", "a mesh or point cloud (PLY)", kForeignMesh},
    {"Kaydara FBX Binary", "an FBX mesh", kForeignMesh},
    {"; FBX ", "an FBX mesh", kForeignMesh},
    {"DRACO", "a mesh that is compressed with Draco", kForeignMesh},
    {"LASF", "a point cloud (LAS or LAZ)", kForeignPoints},
    {"ASTM-E57", "a point cloud (E57)", kForeignPoints},
    {"PK\x03\x04", "a ZIP archive", kForeignUnpack},
    {"\x1f\x8b", "a gzip file", kForeignUnpack},
    {"7z\xbc\xaf\x27\x1c", "a 7z archive", kForeignUnpack},
};

// XML by its root, JSON by its keys: all of `holds` are in the head. `xml`: else JSON.
struct ForeignText {
  bool xml;
  std::vector<std::string_view> holds;
  const char* name;
  const char* remedy;
};

const ForeignText kForeignTexts[] = {
    {true, {"<COLLADA"}, "a COLLADA mesh (DAE)", kForeignMesh},
    {true, {"<OrientationConique>"}, "an orientation of MicMac", kForeignMicMac},
    {true, {"<ExportAPERO>"}, "a file of MicMac", kForeignMicMac},
    {true, {"<ModelMetadata"}, "the metadata of a mesh (metadata.xml)", kForeignCapture},
    {false, {"\"3mxVersion\""}, "a 3MX mesh", kForeignCapture},
    {false, {"\"geometricError\"", "\"root\""}, "a tileset of 3D Tiles", kForeignMesh},
    {false, {"\"featuresFolders\""}, "a scene of Meshroom (SfM)", kForeignMeshroom},
    {false, {"\"views\"", "\"viewId\""}, "a scene of Meshroom (SfM)", kForeignMeshroom},
    {false,
     {"\"sfm_data_version\""},
     "a scene of OpenMVG",
     "in OpenMVG, the scene of openMVG_main_openMVG2openMVS, or "
     "the model of openMVG_main_openMVG2Colmap"},
    {false, {"\"transform_matrix\"", "\"frames\""}, "cameras of NeRF (transforms.json)", kForeignBundler},
};

struct ForeignExtension {
  std::string_view extension;
  const char* name;
  const char* remedy;
};

constexpr ForeignExtension kForeignExtensions[] = {
    {".rcproj", "a project of RealityScan (RealityCapture)",
     "in RealityScan, the registration exported as XMP or as CSV (Internal/External camera parameters), and the model "
     "as OBJ or GLB"},
    {".rsproj", "a project of RealityScan",
     "in RealityScan, the registration exported as XMP or as CSV (Internal/External camera parameters), and the model "
     "as OBJ or GLB"},
    {".p4d", "a project of Pix4D",
     "the project's folder 1_initial/params with calibrated_camera_parameters.txt, and the mesh as OBJ"},
    {".psx", "a project of Metashape",
     "in Metashape, File > Export > Export Cameras as Agisoft XML, and the model as "
     "OBJ, GLB or PLY"},
    {".ccm", "a project of iTwin Capture (ContextCapture)", kForeignCapture},
    {".baf", "a scene of Meshroom (BAF)", kForeignMeshroom},
    {".abc", "a scene of Meshroom (Alembic)", kForeignMeshroom},
    {".osgb", "an OpenSceneGraph mesh (OSGB)", kForeignCapture},
    {".drc", "a mesh that is compressed with Draco", kForeignMesh},
    {".obj", "a mesh (OBJ)", kForeignMesh},
    {".stl", "a mesh (STL)", kForeignMesh},
};

}  // namespace

std::optional<ForeignBlock> RecogniseForeignBlock(std::string_view name, std::string_view head) {
  for (const ForeignSignature& signature : kForeignSignatures) {
    if (head.starts_with(signature.begins)) return ForeignBlock{signature.name, signature.remedy};
  }
  std::string_view text = head;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  const size_t begin = text.find_first_not_of(" \t\r\n");
  const char first = begin == std::string_view::npos ? '\0' : text[begin];
  for (const ForeignText& known : kForeignTexts) {
    if (known.xml ? first != '<' : first != '{') continue;
    const auto in_head = [&](std::string_view part) { return head.find(part) != std::string_view::npos; };
    if (std::all_of(known.holds.begin(), known.holds.end(), in_head)) return ForeignBlock{known.name, known.remedy};
  }
  std::string extension = std::filesystem::path(name).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const ForeignExtension& known : kForeignExtensions) {
    if (extension == known.extension) return ForeignBlock{known.name, known.remedy};
  }
  return std::nullopt;
}

std::optional<ForeignBlock> FindForeignBlock(const std::string& path) {
  constexpr int kMaxDepth = 3, kMaxEntries = 2000, kHeadBytes = 4096;
  namespace fs = std::filesystem;
  const auto recognise = [](const std::string& file) -> std::optional<ForeignBlock> {
    const StatusOr<std::string> head = ReadFileRange(file, 0, kHeadBytes);
    return head.ok() ? RecogniseForeignBlock(file, *head) : std::nullopt;
  };
  std::error_code error;
  if (!fs::is_directory(path, error)) return recognise(path);
  std::vector<std::string> files;
  int entries = 0;
  for (fs::recursive_directory_iterator at(path, fs::directory_options::skip_permission_denied, error), end;
       !error && at != end && entries < kMaxEntries; at.increment(error), ++entries) {
    if (at.depth() >= kMaxDepth - 1) at.disable_recursion_pending();
    std::error_code of_file;
    if (at->is_regular_file(of_file)) files.push_back(at->path().string());
  }
  std::sort(files.begin(), files.end());  // the message does not depend on the order of the folder
  for (const std::string& file : files) {
    if (std::optional<ForeignBlock> found = recognise(file)) {
      found->name = absl::StrCat("a folder with ", found->name, ", ", fs::path(file).lexically_relative(path).string());
      return found;
    }
  }
  return std::nullopt;
}

}  // namespace tessera
