#include "common/blocks/foreign_blocks.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/meshio/foreign_content.h"
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

// Those that common/meshio does not know, or knows as meshes.
constexpr ForeignSignature kForeignSignatures[] = {
    {"# Bundle file", "a Bundler file", kForeignBundler},
    {"glTF", "a mesh (GLB)", kForeignMesh},
    {"ply\n", "a mesh or point cloud (PLY)", kForeignMesh},
    {"ply\r", "a mesh or point cloud (PLY)", kForeignMesh},
};

// XML by its root, JSON by its keys: all of `holds` are in the head. `xml`: else JSON.
struct ForeignText {
  bool xml;
  std::vector<std::string_view> holds;
  const char* name;
  const char* remedy;
};

const ForeignText kForeignTexts[] = {
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

std::optional<ForeignBlock> RecogniseForeignFile(std::string_view head) {
  const std::optional<ForeignContent> content = RecogniseForeignContent(head, static_cast<int64_t>(head.size()));
  if (!content) return std::nullopt;
  switch (content->kind) {
    case ForeignKind::kMesh:
      return ForeignBlock{content->name, kForeignMesh};
    case ForeignKind::kCaptureMesh:
      return ForeignBlock{content->name, kForeignCapture};
    case ForeignKind::kPoints:
      return ForeignBlock{content->name, kForeignPoints};
    case ForeignKind::kPacked:
      return ForeignBlock{content->name, kForeignUnpack};
    case ForeignKind::kXml:  // the file's name may say more
      return std::nullopt;
    case ForeignKind::kOther:
      break;
  }
  return ForeignBlock{content->name, absl::StrCat("a file of a block: ", content->remedy)};
}

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
  if (std::optional<ForeignBlock> file = RecogniseForeignFile(head)) return file;
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
