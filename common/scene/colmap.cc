#include "common/scene/colmap.h"

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int64_t kMaxFileBytes = int64_t{64} << 30;

std::string ReadModelFile(const std::string& path, bool required, const AllowedFiles& allowed, Faults* faults) {
  if (!required && !allowed.Exists(path)) return "";
  StatusOr<std::string> content = allowed.ReadWhole(path, kMaxFileBytes);
  if (content.ok()) return *std::move(content);
  if (absl::IsNotFound(content.status())) {
    faults->Add(InputError(path, "", "no such file", "a file of a COLMAP model"));
  } else {
    faults->Add(content.status());
  }
  return "";
}

}  // namespace

CalibratedImages ReadColmapModel(const std::string& folder, CalibrationContent content, Faults* faults,
                                 const AllowedFiles& allowed) {
  CalibratedImages model;
  const bool binary = allowed.Exists(folder + "/cameras.bin");
  if (!binary && !allowed.Exists(folder + "/cameras.txt")) {
    faults->Add(InputError(folder, "", "neither cameras.bin nor cameras.txt", "a COLMAP sparse model"));
    return model;
  }
  const std::string extension = binary ? ".bin" : ".txt";
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
  (binary ? ParseColmapBinary : ParseColmapText)(cameras, images, points, folder, content, &model, faults);
  return model;
}

}  // namespace tessera
