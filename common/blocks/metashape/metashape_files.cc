#include "common/blocks/metashape/metashape_files.h"

#include <filesystem>
#include <memory>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/storage/zip_file.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMetashapeHeadBytes = 1 << 16;
constexpr int64_t kMaxMetashapePointBytes = int64_t{2} << 30;
constexpr char kMetashapeDocument[] = "doc.xml";
constexpr char kProjectName[] = "{projectname}";

// The root element alone is too common a name.
bool IsMetashapeXml(std::string_view head) {
  return XmlRootName(head) == "document" &&
         (head.find("<chunk") != std::string_view::npos || head.find(".files/project.zip") != std::string_view::npos);
}

int OrientedCameras(const XmlNode& cameras) {
  int count = 0;
  for (XmlNode camera = cameras.Child("camera"); camera; camera = camera.Next("camera")) {
    count += static_cast<bool>(camera.Child("transform"));
  }
  for (XmlNode group = cameras.Child("group"); group; group = group.Next("group")) count += OrientedCameras(group);
  return count;
}

class MetashapeOpener {
 public:
  MetashapeOpener(Faults* faults, Warnings* warnings) : faults_(faults), warnings_(*warnings) {}
  MetashapeFiles TakeResult() { return std::move(result_); }

  void OpenXml(std::string text, const std::string& name) {
    const XmlNode root = AddDocument(std::move(text), name);
    if (root) UseDocument(root, name);
  }

  void OpenArchive(ZipFile archive) {
    StatusOr<std::string> text = archive.Read(kMetashapeDocument, kMaxXmlBytes);
    if (!text.ok()) return faults_->Add(text.status());
    const std::string name = absl::StrCat(archive.name(), "/", kMetashapeDocument);
    const auto shared = std::make_shared<ZipFile>(std::move(archive));
    result_.read_points = [shared](const std::string& member) { return shared->Read(member, kMaxMetashapePointBytes); };
    OpenXml(*std::move(text), name);
  }

  // `folder`: NAME.files, which has project.zip, CHUNK/chunk.zip, CHUNK/FRAME/frame.zip and below it
  // point_cloud/point_cloud.zip; each has a doc.xml.
  void OpenProject(const fs::path& folder) {
    const XmlNode root = ReadArchive(folder / "project.zip");
    if (!root) return;
    result_.version = root.Attribute("version").value_or("");
    XmlNode best;
    fs::path best_path;
    int best_count = -1, chunks = 0;
    for (XmlNode item = root.Child("chunks").Child("chunk"); item; item = item.Next("chunk")) {
      const fs::path path = PathBeside(item, folder / "project.zip");
      const XmlNode chunk = path.empty() ? XmlNode() : ReadArchive(path);
      if (!chunk) continue;
      ++chunks;
      const int count = OrientedCameras(chunk.Child("cameras"));
      if (count > best_count) best_count = count, best = chunk, best_path = path;
    }
    UseChunk(best, chunks, root);
    const XmlNode item = best.Child("frames").Child("frame");
    const fs::path frame_path = item ? PathBeside(item, best_path) : fs::path();
    if (frame_path.empty()) return;
    result_.frame = ReadArchive(frame_path);
    result_.photo_folder = AbsolutePath(frame_path);  // paths of photographs start at the archive
    const XmlNode points =
        result_.frame.Child("point_cloud") ? result_.frame.Child("point_cloud") : result_.frame.Child("tie_points");
    if (!points) return;
    const fs::path points_path = PathBeside(points, frame_path);
    if (points_path.empty()) return;
    if (!fs::is_regular_file(points_path)) {
      warnings_.push_back(
          absl::StrCat(points_path.string(), ": does not exist; the project has no tie points without it"));
      return;
    }
    StatusOr<ZipFile> archive = ZipFile::Open(points_path);
    result_.point_cloud = archive.ok() ? ReadArchive(points_path) : XmlNode();
    if (!archive.ok()) return faults_->Add(archive.status());
    const auto shared = std::make_shared<ZipFile>(*std::move(archive));
    result_.read_points = [shared](const std::string& member) { return shared->Read(member, kMaxMetashapePointBytes); };
  }

 private:
  XmlNode AddDocument(std::string text, const std::string& name) {
    StatusOr<XmlFile> file = XmlFile::Parse(std::move(text), name);
    if (!file.ok()) {
      faults_->Add(file.status());
      return {};
    }
    result_.documents.push_back(*std::move(file));
    return result_.documents.back().Root();
  }

  // The root of the archive's document.
  XmlNode ReadArchive(const fs::path& path) {
    StatusOr<ZipFile> archive = ZipFile::Open(path);
    if (!archive.ok()) {
      faults_->Add(archive.status());
      return {};
    }
    result_.files.push_back(AbsolutePath(path));
    StatusOr<std::string> text = archive->Read(kMetashapeDocument, kMaxXmlBytes);
    if (text.ok()) return AddDocument(*std::move(text), absl::StrCat(path.string(), "/", kMetashapeDocument));
    faults_->Add(text.status());
    return {};
  }

  // The file that `item` names by its path from the folder of `archive`. Empty with a fault if it names none inside.
  fs::path PathBeside(const XmlNode& item, const fs::path& archive) {
    const std::string path(item.Attribute("path").value_or(""));
    const StatusOr<std::string> joined = JoinInside(archive.parent_path(), path);
    if (joined.ok()) return *joined;
    item.AddFault(absl::StrCat("path='", Printable(Prefix(path, 80)), "'"), "a path inside the project", faults_);
    return {};
  }

  void UseDocument(const XmlNode& root, const std::string& name) {
    if (root.Name() != "document") {
      root.AddFault(absl::StrCat("the root element '", Printable(Prefix(root.Name(), 40)), "'"), "document", faults_);
      return;
    }
    result_.version = root.Attribute("version").value_or("");
    XmlNode best;
    int best_count = -1, chunks = 0;
    for (const XmlNode& parent : {root, root.Child("chunks")}) {  // exported cameras; projects
      for (XmlNode chunk = parent.Child("chunk"); chunk; chunk = chunk.Next("chunk"), ++chunks) {
        const int count = OrientedCameras(chunk.Child("cameras"));
        if (count > best_count) best_count = count, best = chunk;
      }
    }
    if (best.Attribute("path")) {
      best.AddFault("a chunk in another file", absl::StrCat("the project's .psx file instead of ", name), faults_);
      return;
    }
    UseChunk(best, chunks, root);
    result_.frame = best.Child("frames").Child("frame");
    result_.point_cloud = result_.frame.Child("point_cloud");
  }

  void UseChunk(const XmlNode& chunk, int chunks, const XmlNode& root) {
    if (!chunk) {
      root.AddFault("no chunk that can be read", "a chunk with cameras", faults_);
      return;
    }
    result_.chunk = chunk;
    if (chunks < 2) return;
    warnings_.push_back(absl::StrCat(chunk.Location(), ": of ", chunks, " chunks, '",
                                     Printable(chunk.Attribute("label").value_or("")),
                                     "' is read, which has most oriented cameras"));
  }

  MetashapeFiles result_;
  Faults* faults_;
  Warnings& warnings_;
};

// The folder NAME.files that a .psx names; empty if `head` is no .psx.
fs::path ProjectFolder(const fs::path& path, const std::string& head) {
  const size_t end = head.find(".files/project.zip");
  if (XmlRootName(head) != "document" || end == std::string::npos) return {};
  const size_t begin = head.rfind('"', end);
  if (begin == std::string::npos) return {};
  std::string name = head.substr(begin + 1, end - begin - 1);
  if (name == kProjectName) name = path.stem();
  return path.parent_path() / (name + ".files");
}

}  // namespace

bool HasMetashapeFiles(const std::string& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return fs::is_regular_file(fs::path(path) / "project.zip", error);
  const StatusOr<std::string> head = ReadFileRange(path, 0, kMetashapeHeadBytes);
  if (!head.ok()) return false;
  if (!IsZip(*head)) return IsMetashapeXml(*head);
  StatusOr<ZipFile> archive = ZipFile::Open(path);
  return archive.ok() && IsMetashapeXml(archive->ReadHead(kMetashapeDocument, kMetashapeHeadBytes));
}

MetashapeFiles OpenMetashapeFiles(const std::string& path, Faults* faults, Warnings* warnings) {
  MetashapeOpener opener(faults, warnings);
  std::error_code error;
  fs::path folder;
  if (fs::is_directory(path, error)) {
    folder = path;
  } else if (const StatusOr<std::string> head = ReadFileRange(path, 0, kMetashapeHeadBytes); head.ok()) {
    folder = ProjectFolder(path, *head);
  }
  if (folder.empty()) {
    StatusOr<std::string> bytes = ReadFile(path);
    if (!bytes.ok()) {
      faults->Add(bytes.status());
      return {};
    }
    MetashapeFiles result = ParseMetashapeFiles(*std::move(bytes), path, faults, warnings);
    result.files = {AbsolutePath(path)};
    if (!result.read_points) {  // an unpacked project
      result.read_points = [parent = fs::path(path).parent_path()](const std::string& member) -> StatusOr<std::string> {
        TESSERA_ASSIGN_OR_RETURN(const std::string file, JoinInside(parent, member));
        return ReadFile(file, kMaxMetashapePointBytes);
      };
    }
    return result;
  }
  if (!fs::is_regular_file(folder / "project.zip", error)) {
    faults->Add(InputError(path, "", absl::StrCat("no ", (folder / "project.zip").string()),
                           "the project's folder of this name beside it"));
    return {};
  }
  opener.OpenProject(folder);
  MetashapeFiles result = opener.TakeResult();
  if (!fs::is_directory(path, error)) result.files.insert(result.files.begin(), AbsolutePath(path));
  return result;
}

MetashapeFiles ParseMetashapeFiles(std::string bytes, const std::string& name, Faults* faults, Warnings* warnings) {
  MetashapeOpener opener(faults, warnings);
  if (!IsZip(bytes)) {
    opener.OpenXml(std::move(bytes), name);
  } else if (StatusOr<ZipFile> archive = ZipFile::Parse(std::move(bytes), name); archive.ok()) {
    opener.OpenArchive(*std::move(archive));
  } else {
    faults->Add(archive.status());
  }
  return opener.TakeResult();
}

}  // namespace tessera
