#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap.h"
#include "common/colmap/colmap_entries.h"
#include "common/colmap/colmap_lines.h"

namespace tessera {
namespace {

void ParseCameras(ColmapLineReader lines, ColmapBuilder* builder) {
  while (lines.NextEntry()) {
    uint32_t id = 0;
    uint64_t width = 0, height = 0;
    std::string model;
    const auto fault = [&](const char* expected) {
      builder->faults().Add(lines.Location().Error(lines.Peek(), expected));
    };
    if (!lines.Number(&id)) {
      fault("a camera id");
      continue;
    }
    model = lines.Word();
    if (!lines.Number(&width) || !lines.Number(&height)) {
      fault("CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
      continue;
    }
    std::vector<double> parameters;
    bool good = true;
    while (good && !lines.AtEnd()) good = lines.Number(&parameters.emplace_back());
    if (!good) {
      fault("a number");
      continue;
    }
    builder->AddCamera(lines.Location(), id, FindColmapCameraModel(model), model, width, height, parameters);
  }
}

// Parses triples "X Y POINT3D_ID"; an id of -1 means no 3D point.
bool ParseObservations(ColmapLineReader& lines, std::vector<ImageObservation>* observations) {
  while (!lines.AtEnd()) {
    ImageObservation observation;
    int64_t point_id = -1;
    if (!lines.Number(&observation.position_px.x()) || !lines.Number(&observation.position_px.y()) ||
        !lines.Number(&point_id)) {
      return false;
    }
    if (point_id < 0) continue;
    observation.point_id = static_cast<uint64_t>(point_id);
    observations->push_back(observation);
  }
  return true;
}

// Whether the line is an image's first, with its pose and name, and not one of image points.
bool IsPoseLine(ColmapLineReader& lines) {
  const ColmapLineReader::Cursor start = lines.cursor();
  uint32_t id = 0, camera_id = 0;
  double value = 0;
  bool is_pose = lines.Number(&id);
  for (int k = 0; k < 7; ++k) is_pose = is_pose && lines.Number(&value);
  is_pose = is_pose && lines.Number(&camera_id) && !lines.AtEnd();
  if (is_pose) {  // a name follows, unless the line has only numbers, three for each image point
    int64_t words = 0;
    bool numbers = true;
    for (; numbers && !lines.AtEnd(); ++words) numbers = lines.Number(&value);
    is_pose = !numbers || words % 3 != 0;
  }
  lines.Return(start);
  return is_pose;
}

// Finds a file in which some images have a line of image points, even an empty one, and others have none: poses and
// points cannot be told apart with certainty.
class PointLines {
 public:
  // `line`: of the pose of an image that another pose follows.
  void Missing(const ColmapLocation& location, int64_t line, ColmapBuilder* builder) {
    if (first_missing_ == 0) first_missing_ = line;
    Report(location, "no line of image points after the image of this line", builder);
  }
  // `line`: of image points, not blank.
  void Found(const ColmapLocation& location, int64_t line, ColmapBuilder* builder) {
    if (first_found_ == 0) first_found_ = line;
    Report(location, "a line of image points", builder);
  }

 private:
  void Report(const ColmapLocation& location, const char* found, ColmapBuilder* builder) {
    if (first_missing_ == 0 || first_found_ == 0 || std::exchange(reported_, true)) return;
    builder->faults().Add(location.Error(
        found, first_missing_ < first_found_
                   ? absl::StrCat("a line of image points for each image, or for none: the image of line ",
                                  first_missing_, " has none")
                   : absl::StrCat("a line of image points for each image, or for none: line ", first_found_,
                                  " has image points")));
  }
  int64_t first_missing_ = 0, first_found_ = 0;
  bool reported_ = false;
};

void ParseImages(ColmapLineReader lines, CalibrationContent content, ColmapBuilder* builder) {
  PointLines point_lines;
  while (lines.NextEntry()) {
    CalibratedImage image;
    double q[4];
    Eigen::Vector3d& t = image.translation_cam_from_world;
    const ColmapLocation location = lines.Location();
    const int64_t line = lines.number();
    bool good = lines.Number(&image.id);
    if (!good) builder->faults().Add(location.Error(lines.Peek(), "an image id"));
    if (good) {
      good = lines.Number(&q[0]) && lines.Number(&q[1]) && lines.Number(&q[2]) && lines.Number(&q[3]) &&
             lines.Number(&t.x()) && lines.Number(&t.y()) && lines.Number(&t.z()) && lines.Number(&image.camera_id);
      if (good) image.name = lines.Rest();
      good = good && !image.name.empty();
      if (!good) {
        builder->faults().Add(location.Error(lines.Peek(), "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"));
      }
    }
    // The second line of an image holds its image points. It may be empty, and may be missing at the end of the file.
    // Some programs write no such lines; then the next pose follows.
    const ColmapLineReader::Cursor pose = lines.cursor();
    if (lines.NextContent()) {
      if (IsPoseLine(lines)) {
        lines.Return(pose);
        point_lines.Missing(location, line, builder);
      } else {
        if (!lines.AtEnd()) point_lines.Found(lines.Location(), lines.number(), builder);
        // Image points are not needed for cameras alone, but a faulty pose must not pass for some.
        const bool read =
            content == CalibrationContent::kCamerasAndPoints || (!lines.AtEnd() && !lines.LastWordIsNumber());
        if (read && !ParseObservations(lines, &image.observations)) {
          builder->faults().Add(lines.Location().Error(lines.Peek(), "X Y POINT3D_ID"));
        }
      }
    }
    if (good) builder->AddImage(location, std::move(image), q);
  }
}

void ParsePoints(ColmapLineReader lines, ColmapBuilder* builder) {
  while (lines.NextEntry()) {
    TiePoint point;
    Eigen::Vector3d& p = point.position;
    int colour = 0;
    double error = 0;
    bool good = lines.Number(&point.id) && lines.Number(&p.x()) && lines.Number(&p.y()) && lines.Number(&p.z());
    for (int k = 0; k < 3; ++k) good = good && lines.Number(&colour);
    good = good && lines.Number(&error);
    while (good && !lines.AtEnd()) {
      uint32_t image_id = 0, index = 0;
      good = lines.Number(&image_id) && lines.Number(&index);
      point.image_ids.push_back(image_id);
    }
    if (!good) {
      builder->faults().Add(
          lines.Location().Error(lines.Peek(), "POINT3D_ID X Y Z R G B ERROR (IMAGE_ID POINT2D_IDX)..."));
      continue;
    }
    builder->AddPoint(lines.Location(), std::move(point));
  }
}

}  // namespace

void ParseColmapText(const std::string& cameras, const std::string& images, const std::string& points,
                     const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults) {
  bool good = true;
  for (const auto& [name, text] :
       {std::pair("/cameras.txt", &cameras), std::pair("/images.txt", &images), std::pair("/points3D.txt", &points)}) {
    if (!text->starts_with("\xff\xfe") && !text->starts_with("\xfe\xff")) continue;
    faults->Add(InputError(folder + name, "", "a text in UTF-16", "UTF-8: save the file in that encoding"));
    good = false;
  }
  if (!good) return;
  ColmapBuilder builder(model, faults);
  ParseCameras(ColmapLineReader(cameras, folder + "/cameras.txt"), &builder);
  ParseImages(ColmapLineReader(images, folder + "/images.txt"), content, &builder);
  if (content == CalibrationContent::kCamerasAndPoints)
    ParsePoints(ColmapLineReader(points, folder + "/points3D.txt"), &builder);
  builder.Finish();
}

}  // namespace tessera
