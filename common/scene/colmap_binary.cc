#include <bit>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "common/scene/colmap.h"
#include "common/scene/colmap_entries.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little, "COLMAP's binary files are little-endian");

// Reads values from a byte string. After reading beyond its end, ok() is false and all values are zero.
class ByteReader {
 public:
  ByteReader(const std::string& bytes, std::string file) : bytes_(bytes), file_(std::move(file)) {}

  template <class T>
  T Read() {
    T value{};
    if (Take(sizeof(T))) std::memcpy(&value, bytes_.data() + at_ - sizeof(T), sizeof(T));
    return value;
  }
  Eigen::Vector3d ReadVector3() {
    const double x = Read<double>(), y = Read<double>(), z = Read<double>();
    return {x, y, z};
  }
  std::string ReadName() {
    const size_t end = ok_ ? bytes_.find('\0', at_) : std::string::npos;
    if (end == std::string::npos) {
      ok_ = false;
      return "";
    }
    std::string name = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return name;
  }
  bool Skip(uint64_t count, uint64_t size_bytes) {
    ok_ = ok_ && count <= (bytes_.size() - at_) / size_bytes;
    return ok_ && Take(count * size_bytes);
  }
  bool CanHold(uint64_t count, uint64_t size_bytes) const { return count <= (bytes_.size() - at_) / size_bytes; }
  bool ok() const { return ok_; }
  size_t left() const { return bytes_.size() - at_; }
  ColmapLocation Location() const { return {file_, absl::StrCat("byte ", at_)}; }
  ColmapLocation EndLocation() const { return {file_, absl::StrCat("byte ", bytes_.size())}; }

  // Reads the number of entries, and checks that the file is large enough for them at `smallest_bytes` each.
  bool Count(uint64_t smallest_bytes, uint64_t* count, Faults* faults) {
    const ColmapLocation location = Location();
    *count = Read<uint64_t>();
    if (!ok_) {
      faults->Add(EndLocation().Error("the end of the file", "a number of entries"));
      return false;
    }
    if (!CanHold(*count, smallest_bytes)) {
      faults->Add(location.Error(absl::StrCat(*count, " entries"),
                                 absl::StrCat("at most ", left() / smallest_bytes, ", which fit in the file")));
      return false;
    }
    return true;
  }
  void Truncated(uint64_t entry, uint64_t count, const char* what, Faults* faults) const {
    faults->Add(EndLocation().Error("the end of the file", absl::StrCat(what, " ", entry + 1, " of ", count)));
  }
  void CheckEnd(Faults* faults) const {
    if (left() > 0) faults->Add(Location().Error(absl::StrCat(left(), " more bytes"), "the end of the file"));
  }

 private:
  bool Take(size_t size) {
    ok_ = ok_ && size <= bytes_.size() - at_;
    if (ok_) at_ += size;
    return ok_;
  }
  const std::string& bytes_;
  std::string file_;
  size_t at_ = 0;
  bool ok_ = true;
};

void ParseCameras(ByteReader in, ColmapBuilder* builder) {
  uint64_t count = 0;
  if (!in.Count(24 + 3 * 8, &count, &builder->faults())) return;
  for (uint64_t i = 0; i < count; ++i) {
    const ColmapLocation location = in.Location();
    const uint32_t id = in.Read<uint32_t>();
    const int32_t model_id = in.Read<int32_t>();
    const uint64_t width = in.Read<uint64_t>(), height = in.Read<uint64_t>();
    const ColmapCameraModel* model = FindColmapCameraModel(model_id);
    if (in.ok() && model == nullptr) {  // its number of parameters is unknown, so stop here
      builder->AddCamera(location, id, model, absl::StrCat(model_id), width, height, {});
      return;
    }
    std::vector<double> parameters(model == nullptr ? 0 : model->parameters);
    for (double& parameter : parameters) parameter = in.Read<double>();
    if (!in.ok()) return in.Truncated(i, count, "camera", &builder->faults());
    builder->AddCamera(location, id, model, model->name, width, height, parameters);
  }
  in.CheckEnd(&builder->faults());
}

void ParseImages(ByteReader in, CalibrationContent content, ColmapBuilder* builder) {
  uint64_t count = 0;
  if (!in.Count(4 + 7 * 8 + 4 + 1 + 8, &count, &builder->faults())) return;
  for (uint64_t i = 0; i < count; ++i) {
    const ColmapLocation location = in.Location();
    CalibratedImage image;
    image.id = in.Read<uint32_t>();
    double q[4];
    for (double& value : q) value = in.Read<double>();
    image.translation_cam_from_world = in.ReadVector3();
    image.camera_id = in.Read<uint32_t>();
    image.name = in.ReadName();
    const uint64_t observations = in.Read<uint64_t>();
    if (content == CalibrationContent::kCameras) {
      in.Skip(observations, 24);
    } else if (in.ok() && in.CanHold(observations, 24)) {
      for (uint64_t k = 0; k < observations; ++k) {
        const double x = in.Read<double>(), y = in.Read<double>();
        const uint64_t point_id = in.Read<uint64_t>();
        if (point_id != UINT64_MAX) image.observations.push_back({{x, y}, point_id});
      }
    } else {
      in.Skip(UINT64_MAX, 24);
    }
    if (!in.ok()) return in.Truncated(i, count, "image", &builder->faults());
    if (image.name.empty()) {
      builder->faults().Add(location.Error("an image without a name", "a file name"));
      continue;
    }
    builder->AddImage(location, std::move(image), q);
  }
  in.CheckEnd(&builder->faults());
}

void ParsePoints(ByteReader in, ColmapBuilder* builder) {
  uint64_t count = 0;
  if (!in.Count(8 + 24 + 3 + 8 + 8, &count, &builder->faults())) return;
  for (uint64_t i = 0; i < count; ++i) {
    const ColmapLocation location = in.Location();
    TiePoint point;
    point.id = in.Read<uint64_t>();
    point.position = in.ReadVector3();
    in.Skip(3 + 8, 1);  // colour and error
    const uint64_t track = in.Read<uint64_t>();
    if (!in.ok() || !in.CanHold(track, 8)) return in.Truncated(i, count, "point", &builder->faults());
    for (uint64_t k = 0; k < track; ++k) {
      point.image_ids.push_back(in.Read<uint32_t>());
      in.Read<uint32_t>();
    }
    builder->AddPoint(location, std::move(point));
  }
  in.CheckEnd(&builder->faults());
}

}  // namespace

void ParseColmapBinary(const std::string& cameras, const std::string& images, const std::string& points,
                       const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults) {
  ColmapBuilder builder(model, faults);
  ParseCameras(ByteReader(cameras, folder + "/cameras.bin"), &builder);
  ParseImages(ByteReader(images, folder + "/images.bin"), content, &builder);
  if (content == CalibrationContent::kCamerasAndPoints && !points.empty()) {
    ParsePoints(ByteReader(points, folder + "/points3D.bin"), &builder);
  }
  builder.Finish();
}

}  // namespace tessera
