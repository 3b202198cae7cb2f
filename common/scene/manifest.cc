#include "common/scene/manifest.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/base/json_bounds.h"
#include "common/base/printable.h"
#include "common/s3/s3_location.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr int kManifestVersion = 1;
constexpr size_t kMaxManifestFiles = 2'000'000;
constexpr int64_t kMaxImageSide = 1 << 20;
constexpr size_t kMaxFaultBytes = 1000;

// Reads the values of an entry; the first fault is kept.
class EntryReader {
 public:
  EntryReader(const Json& json, const std::string& file, std::string place)
      : json_(json), file_(file), place_(std::move(place)) {}

  std::string Text(const char* key, size_t max_bytes) {
    const auto found = json_.find(key);
    if (found == json_.end() || !found->is_string()) return Fail(key, "no text", "a text"), "";
    const std::string& text = found->get_ref<const std::string&>();
    if (text.size() > max_bytes) return Fail(key, "a long text", absl::StrCat("at most ", max_bytes, " bytes")), "";
    return text;
  }
  int64_t Number(const char* key, int64_t least, int64_t most) {
    const auto found = json_.find(key);
    const bool fits = found != json_.end() && found->is_number_integer() &&
                      !(found->is_number_unsigned() && found->get<uint64_t>() > static_cast<uint64_t>(INT64_MAX));
    if (fits && found->get<int64_t>() >= least && found->get<int64_t>() <= most) return found->get<int64_t>();
    Fail(key, "no such number", absl::StrCat("a whole number from ", least, " to ", most));
    return least;
  }
  bool Flag(const char* key) {
    const auto found = json_.find(key);
    if (found != json_.end() && found->is_boolean()) return found->get<bool>();
    Fail(key, "no such value", "true or false");
    return false;
  }
  void Fail(const char* key, const std::string& found, const std::string& expected) {
    if (status_.ok()) status_ = InputError(file_, absl::StrCat(place_, ".", key), found, expected);
  }
  const Status& status() const { return status_; }

 private:
  const Json& json_;
  const std::string& file_;
  const std::string place_;
  Status status_;
};

StatusOr<ManifestFile> ReadEntry(const Json& json, const std::string& file, const std::string& place) {
  if (!json.is_object()) return InputError(file, place, "no object", "an object with name, size and sha256");
  EntryReader reader(json, file, place);
  ManifestFile entry;
  entry.name = reader.Text("name", 1024);
  entry.digest = {reader.Text("sha256", 64), reader.Number("size", 0, INT64_MAX)};
  TESSERA_RETURN_IF_ERROR(reader.status());
  if (!CheckS3Key(entry.name).ok()) {
    reader.Fail("name", absl::StrCat("'", Printable(Prefix(entry.name, 100)), "'"), "a path inside the scene");
  }
  if (!CheckDigest(entry.digest).ok()) reader.Fail("sha256", "another text", "64 lower-case hex digits");
  TESSERA_RETURN_IF_ERROR(reader.status());
  if (json.contains("modified_ns")) entry.modified_ns = reader.Number("modified_ns", 0, INT64_MAX);
  TESSERA_RETURN_IF_ERROR(reader.status());
  if (const auto fault = json.find("fault"); fault != json.end()) {
    const std::string fault_place = place + ".fault";
    if (!fault->is_object()) return InputError(file, fault_place, "no object", "an object with found and expected");
    EntryReader parts(*fault, file, fault_place);
    entry.fault =
        InputFault{"", Printable(parts.Text("location", kMaxFaultBytes)),
                   Printable(parts.Text("found", kMaxFaultBytes)), Printable(parts.Text("expected", kMaxFaultBytes))};
    TESSERA_RETURN_IF_ERROR(parts.status());
  }
  const auto image = json.find("image");
  if (image == json.end()) return entry;
  const std::string image_place = place + ".image";
  if (!image->is_object()) return InputError(file, image_place, "no object", "an object with width and height");
  EntryReader facts(*image, file, image_place);
  ImageHeader header;
  header.size.width = static_cast<int>(facts.Number("width", 1, kMaxImageSide));
  header.size.height = static_cast<int>(facts.Number("height", 1, kMaxImageSide));
  header.bits = static_cast<int>(facts.Number("bits", 1, 64));
  header.has_alpha = facts.Flag("alpha");
  header.orientation = static_cast<int>(facts.Number("orientation", 1, 8));
  TESSERA_RETURN_IF_ERROR(facts.status());
  entry.image = header;
  return entry;
}

bool ByName(const ManifestFile& a, const ManifestFile& b) { return a.name < b.name; }

}  // namespace

bool IsPartOfScene(const std::string& name) {
  return name != kManifestName && !absl::StartsWith(name, ".") && !absl::StrContains(name, "/.") &&
         !absl::EndsWith(name, "/");  // objects of such names stand for folders
}

bool IsOfCameraModel(const std::string& name) {
  const std::filesystem::path path(name);
  const std::string extension = path.extension().string(), stem = path.stem().string();
  return (extension == ".bin" || extension == ".txt") &&
         (stem == "cameras" || stem == "images" || stem == "frames" || stem == "rigs");
}

const ManifestFile* FindFile(const SceneManifest& manifest, const std::string& name) {
  const auto found =
      std::lower_bound(manifest.files.begin(), manifest.files.end(), name,
                       [](const ManifestFile& file, const std::string& text) { return file.name < text; });
  return found != manifest.files.end() && found->name == name ? &*found : nullptr;
}

Status FaultOf(const ManifestFile& file, const std::string& folder) {
  if (!file.fault) return absl::OkStatus();
  return InputError(folder + file.name, file.fault->location, file.fault->found, file.fault->expected);
}

StatusOr<SceneManifest> ParseManifest(const std::string& text, const std::string& file) {
  if (static_cast<int64_t>(text.size()) > kMaxManifestBytes) {
    return InputError(file, "", absl::StrCat(text.size(), " bytes"), absl::StrCat("at most ", kMaxManifestBytes));
  }
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(file, text));
  const Json json = Json::parse(text, nullptr, false);
  const auto version = json.is_object() ? json.find("tessera_manifest") : json.end();
  if (!json.is_object() || version == json.end()) {
    return InputError(file, "", "no manifest of a scene", "the file that tessera upload writes");
  }
  if (!version->is_number_integer() || *version != kManifestVersion) {
    return InputError(file, "tessera_manifest", "another version", absl::StrCat(kManifestVersion));
  }
  const auto files = json.find("files");
  if (files == json.end() || !files->is_array() || files->size() > kMaxManifestFiles) {
    return InputError(file, "files", "no list", absl::StrCat("a list of at most ", kMaxManifestFiles, " files"));
  }
  SceneManifest manifest;
  manifest.files.reserve(files->size());
  for (size_t i = 0; i < files->size(); ++i) {
    TESSERA_ASSIGN_OR_RETURN(ManifestFile entry, ReadEntry((*files)[i], file, absl::StrCat("files[", i, "]")));
    if (!manifest.files.empty() && !ByName(manifest.files.back(), entry)) {
      return InputError(file, absl::StrCat("files[", i, "].name"), absl::StrCat("'", Printable(entry.name), "'"),
                        "names in ascending order, each once");
    }
    manifest.files.push_back(std::move(entry));
  }
  return manifest;
}

std::string ToJson(SceneManifest manifest) {
  std::sort(manifest.files.begin(), manifest.files.end(), ByName);
  std::string text = absl::StrCat("{\"tessera_manifest\": ", kManifestVersion, ", \"files\": [");
  const char* separator = "\n";
  for (const ManifestFile& file : manifest.files) {
    absl::StrAppend(&text, separator, "{\"name\": ", JsonQuoted(file.name), ", \"size\": ", file.digest.size_bytes,
                    ", \"sha256\": \"", file.digest.sha256, "\"");
    if (file.image) {
      absl::StrAppend(&text, ", \"image\": {\"width\": ", file.image->size.width,
                      ", \"height\": ", file.image->size.height, ", \"bits\": ", file.image->bits,
                      ", \"alpha\": ", file.image->has_alpha ? "true" : "false",
                      ", \"orientation\": ", file.image->orientation, "}");
    }
    if (file.fault) {
      absl::StrAppend(&text, ", \"fault\": {\"location\": ", JsonQuoted(file.fault->location),
                      ", \"found\": ", JsonQuoted(file.fault->found),
                      ", \"expected\": ", JsonQuoted(file.fault->expected), "}");
    }
    if (file.modified_ns > 0) absl::StrAppend(&text, ", \"modified_ns\": ", file.modified_ns);
    text += "}";
    separator = ",\n";
  }
  return text + "\n]}\n";
}

bool MayBeImage(const std::string& name, std::string_view head) {
  const std::string lower = absl::AsciiStrToLower(name);
  for (const char* ending : {".jpg", ".jpeg", ".png", ".tif", ".tiff"}) {
    if (absl::EndsWith(lower, ending)) return true;
  }
  head = head.substr(0, 16);
  const std::vector<uint8_t> bytes(head.begin(), head.end());
  return IsJpeg(bytes) || IsPng(bytes) || IsTiff(bytes);
}

void ReadImageFacts(const std::string& path, ManifestFile* file) {
  if (!MayBeImage(file->name, ReadFileRange(path, 0, 16).value_or(""))) return;
  const StatusOr<ImageHeader> header = ReadImageHeader(path);
  if (header.ok()) {
    file->image = *header;
    return;
  }
  const auto text = [&](const std::string& part) {
    return std::string(Prefix(Printable(absl::StrReplaceAll(part, {{path, file->name}})), kMaxFaultBytes));
  };
  const std::vector<InputFault> faults = FaultsOf(header.status());
  const InputFault fault =
      faults.empty() ? InputFault{"", "", std::string(header.status().message()), "an image"} : faults.front();
  file->fault = InputFault{"", text(fault.location), text(fault.found), text(fault.expected)};
}

}  // namespace tessera
