#include "absl/strings/str_cat.h"
#include "common/colmap/colmap.h"
#include "common/colmap/colmap_bytes.h"
#include "common/colmap/colmap_entries.h"

namespace tessera {
namespace {

void ParseCameras(ColmapByteReader in, ColmapBuilder* builder) {
  uint64_t count = 0;
  if (!in.Count(24 + 2 * 8, &count, &builder->faults())) return;
  for (uint64_t i = 0; i < count; ++i) {
    const ColmapLocation location = in.Location();
    const uint32_t id = in.Read<uint32_t>();
    const int32_t model_id = in.Read<int32_t>();
    const uint64_t width = in.Read<uint64_t>(), height = in.Read<uint64_t>();
    const ColmapCameraModel* model = FindColmapCameraModel(model_id);
    if (in.ok() && model == nullptr) {  // its number of parameters is unknown, so stop here
      builder->AddCamera(location, id, model, absl::StrCat(model_id), width, height, {});
      builder->OmitsCameras();
      return;
    }
    std::vector<double> parameters(model == nullptr ? 0 : model->parameters);
    for (double& parameter : parameters) parameter = in.Read<double>();
    if (!in.ok()) return in.Truncated(i, count, "camera", &builder->faults());
    builder->AddCamera(location, id, model, model->name, width, height, parameters);
  }
  in.CheckEnd(&builder->faults());
}

void ParseImages(ColmapByteReader in, CalibrationContent content, ColmapBuilder* builder) {
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

void ParsePoints(ColmapByteReader in, ColmapBuilder* builder) {
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
  ParseCameras(ColmapByteReader(cameras, folder + "/cameras.bin"), &builder);
  ParseImages(ColmapByteReader(images, folder + "/images.bin"), content, &builder);
  if (content == CalibrationContent::kCamerasAndPoints && !points.empty()) {
    ParsePoints(ColmapByteReader(points, folder + "/points3D.bin"), &builder);
  }
  builder.Finish();
}

}  // namespace tessera
