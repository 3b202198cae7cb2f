#include "common/colmap/colmap.h"

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/colmap/colmap_compare.h"
#include "common/colmap/colmap_frames.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

constexpr int64_t kMaxFileBytes = int64_t{64} << 30;
constexpr int kMaxSubModels = 100;

std::string ReadModelFile(const std::string& path, bool required, const AllowedFiles& allowed, Faults* faults) {
  if (!required && !allowed.Exists(path)) return "";
  StatusOr<std::string> content = allowed.ReadWhole(path, kMaxFileBytes);
  if (content.ok() && IsLfsPointer(*content)) {
    faults->Add(LfsPointerError(path));
    return "";
  }
  if (content.ok()) return *std::move(content);
  if (absl::IsNotFound(content.status())) {
    faults->Add(InputError(path, "", "no such file", "a file of a COLMAP model"));
  } else {
    faults->Add(content.status());
  }
  return "";
}

bool HasModel(const std::string& folder, const AllowedFiles& allowed) {
  return allowed.Exists(folder + "/cameras.bin") || allowed.Exists(folder + "/cameras.txt");
}

// Reads the model of one form: `extension` is ".bin" or ".txt".
CalibratedImages ReadForm(const std::string& folder, const std::string& extension, CalibrationContent content,
                          const AllowedFiles& allowed, Faults* faults) {
  CalibratedImages model;
  for (const char* stem : {"cameras", "images"}) {
    if (allowed.Exists(absl::StrCat(folder, "/", stem, extension))) model.files.push_back(stem + extension);
  }
  const size_t faults_before = faults->messages().size();
  const std::string cameras = ReadModelFile(absl::StrCat(folder, "/cameras", extension), true, allowed, faults);
  const std::string images = ReadModelFile(absl::StrCat(folder, "/images", extension), true, allowed, faults);
  const std::string points = content == CalibrationContent::kCamerasAndPoints
                                 ? ReadModelFile(absl::StrCat(folder, "/points3D", extension), false, allowed, faults)
                                 : "";
  if (faults->messages().size() > faults_before) return model;
  (extension == ".bin" ? ParseColmapBinary : ParseColmapText)(cameras, images, points, folder, content, &model, faults);
  return model;
}

// The modification time of the newer one of the form's files; none if a file cannot be opened.
std::optional<int64_t> ModifiedNs(const std::string& folder, const std::string& extension,
                                  const AllowedFiles& allowed) {
  int64_t newest_ns = 0;
  for (const char* stem : {"/cameras", "/images"}) {
    const StatusOr<AllowedFile> file = allowed.Open(absl::StrCat(folder, stem, extension));
    const StatusOr<int64_t> modified_ns = file.ok() ? file->ModifiedNs() : StatusOr<int64_t>(file.status());
    if (!modified_ns.ok()) return std::nullopt;
    newest_ns = std::max(newest_ns, *modified_ns);
  }
  return newest_ns;
}

// The form that is read of a folder with a model.
std::string ChooseForm(const std::string& folder, const AllowedFiles& allowed, Warnings* warnings) {
  if (!allowed.Exists(folder + "/cameras.bin")) return ".txt";
  if (!allowed.Exists(folder + "/cameras.txt") || !allowed.Exists(folder + "/images.txt")) return ".bin";
  Faults of_binary, of_text;
  const CalibratedImages binary = ReadForm(folder, ".bin", CalibrationContent::kCameras, allowed, &of_binary);
  const CalibratedImages text = ReadForm(folder, ".txt", CalibrationContent::kCameras, allowed, &of_text);
  if (!of_binary.empty()) return ".bin";  // its faults are reported
  if (!of_text.empty()) {
    warnings->push_back(absl::StrCat(
        folder, ": the binary model is used; the text model beside it has faults: ", of_text.messages().front()));
    return ".bin";
  }
  const ModelDifference difference = CompareModels(binary, text);
  if (!difference.exceeds_rounding) return ".bin";
  const bool newer_text = ModifiedNs(folder, ".txt", allowed) > ModifiedNs(folder, ".bin", allowed);
  warnings->push_back(absl::StrCat(
      folder, ": the text model and the binary model differ by up to ",
      DistanceText(difference.centre_m, difference.angle_rad), " of an image and ",
      absl::StrFormat("%.2f px of a camera", difference.image_px),
      difference.unmatched > 0 ? absl::StrCat("; ", difference.unmatched, " images are in one only") : "", ": the ",
      newer_text ? "text" : "binary", " model is used, because its files are newer; delete the other one"));
  return newer_text ? ".txt" : ".bin";
}

// Reads the model in a folder that has one.
CalibratedImages ReadFolder(const std::string& folder, CalibrationContent content, const AllowedFiles& allowed,
                            Warnings* warnings, Faults* faults) {
  const std::string extension = ChooseForm(folder, allowed, warnings);
  CalibratedImages model = ReadForm(folder, extension, content, allowed, faults);
  const std::string frames = absl::StrCat(folder, "/frames", extension),
                    rigs = absl::StrCat(folder, "/rigs", extension);
  if (!allowed.Exists(frames) || !allowed.Exists(rigs)) return model;
  Faults of_frames;
  const std::string rigs_content = ReadModelFile(rigs, true, allowed, &of_frames);
  const std::string frames_content = ReadModelFile(frames, true, allowed, &of_frames);
  if (of_frames.empty()) {
    const ColmapFrames read = (extension == ".bin" ? ParseColmapFramesBinary : ParseColmapFramesText)(
        rigs_content, frames_content, folder, &of_frames);
    if (of_frames.empty()) CompareWithFrames(model, read, folder, extension, faults);
  }
  if (!of_frames.empty()) {
    warnings->push_back(absl::StrCat(folder, ": the poses of images", extension,
                                     " are not compared with those of frames", extension, ": ",
                                     of_frames.messages().front()));
  }
  return model;
}

// The folders below `folder` that COLMAP and programs that call it write models to, relative to it.
std::vector<std::string> FindSubModels(const std::string& folder, const AllowedFiles& allowed) {
  std::vector<std::string> found;
  const auto add = [&](const std::string& name) {
    if (HasModel(absl::StrCat(folder, "/", name), allowed)) found.push_back(name);
  };
  for (int i = 0; i < kMaxSubModels; ++i) add(absl::StrCat(i));
  add("sparse");
  for (int i = 0; i < kMaxSubModels; ++i) add(absl::StrCat("sparse/", i));
  return found;
}

}  // namespace

CalibratedImages ReadColmapModel(const std::string& folder, CalibrationContent content, Faults* faults,
                                 const AllowedFiles& allowed, Warnings* warnings) {
  Warnings unused;
  if (warnings == nullptr) warnings = &unused;
  if (HasModel(folder, allowed)) return ReadFolder(folder, content, allowed, warnings, faults);
  const std::vector<std::string> names = FindSubModels(folder, allowed);
  if (names.empty()) {
    faults->Add(InputError(folder, "", "neither cameras.bin nor cameras.txt", "a COLMAP sparse model"));
    return {};
  }
  std::vector<size_t> images;
  for (const std::string& name : names) {
    Warnings of_model;
    Faults unreported;
    images.push_back(
        ReadFolder(absl::StrCat(folder, "/", name), CalibrationContent::kCameras, allowed, &of_model, &unreported)
            .images.size());
  }
  const auto chosen = static_cast<size_t>(std::max_element(images.begin(), images.end()) - images.begin());
  warnings->push_back(absl::StrCat(folder, ": has no model itself; that of ", names[chosen], " is used, with ",
                                   images[chosen], " images"));
  std::vector<std::string> others;
  for (size_t i = 0; i < names.size(); ++i) {
    if (i != chosen) others.push_back(absl::StrCat(names[i], " (", images[i], " images)"));
  }
  if (!others.empty()) {
    warnings->push_back(absl::StrCat(folder, ": has more models, which are not used: ", absl::StrJoin(others, ", ")));
  }
  CalibratedImages model = ReadFolder(absl::StrCat(folder, "/", names[chosen]), content, allowed, warnings, faults);
  for (std::string& file : model.files) file = absl::StrCat(names[chosen], "/", file);
  return model;
}

}  // namespace tessera
