#include <charconv>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/scene/colmap.h"
#include "common/scene/colmap_entries.h"

namespace tessera {
namespace {

// Reads a text line by line, with line numbers, and the words of the current line.
class LineReader {
 public:
  LineReader(const std::string& text, std::string file) : text_(text), file_(std::move(file)) {}

  bool Next() {
    if (at_ >= text_.size()) return false;
    size_t end = text_.find('\n', at_);
    if (end == std::string::npos) end = text_.size();
    word_ = at_;
    line_end_ = end;
    if (line_end_ > word_ && text_[line_end_ - 1] == '\r') --line_end_;
    at_ = end + 1;
    ++number_;
    return true;
  }
  // The next line that is neither blank nor a comment.
  bool NextEntry() {
    while (Next()) {
      if (!AtEnd() && text_[word_] != '#') return true;
    }
    return false;
  }
  bool AtEnd() {
    while (word_ < line_end_ && (text_[word_] == ' ' || text_[word_] == '\t')) ++word_;
    return word_ >= line_end_;
  }
  std::string Word() {
    if (AtEnd()) return "";
    const size_t begin = word_;
    while (word_ < line_end_ && text_[word_] != ' ' && text_[word_] != '\t') ++word_;
    return text_.substr(begin, word_ - begin);
  }
  // The rest of the line without blanks at its ends; image names may contain blanks.
  std::string Rest() {
    if (AtEnd()) return "";
    size_t end = line_end_;
    while (end > word_ && (text_[end - 1] == ' ' || text_[end - 1] == '\t')) --end;
    return text_.substr(std::exchange(word_, line_end_), end - word_);
  }
  template <class T>
  bool Number(T* out) {
    if (AtEnd()) return false;
    const char* end = text_.data() + line_end_;
    const auto [stop, error] = std::from_chars(text_.data() + word_, end, *out);
    if (error != std::errc() || (stop != end && *stop != ' ' && *stop != '\t')) return false;
    word_ = static_cast<size_t>(stop - text_.data());
    return true;
  }
  // The next word, for messages; does not consume it.
  std::string Peek() {
    if (AtEnd()) return "the end of the line";
    const size_t keep = word_;
    const std::string word = Word();
    word_ = keep;
    return absl::StrCat("'", word.substr(0, 40), "'");
  }
  ColmapLocation Location() const { return {file_, absl::StrCat("line ", number_)}; }

 private:
  const std::string& text_;
  std::string file_;
  size_t at_ = 0, word_ = 0, line_end_ = 0;
  int64_t number_ = 0;
};

void ParseCameras(LineReader lines, ColmapBuilder* builder) {
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
bool ParseObservations(LineReader& lines, std::vector<ImageObservation>* observations) {
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

void ParseImages(LineReader lines, CalibrationContent content, ColmapBuilder* builder) {
  while (lines.NextEntry()) {
    CalibratedImage image;
    double q[4];
    Eigen::Vector3d& t = image.translation_cam_from_world;
    const ColmapLocation location = lines.Location();
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
    if (lines.Next() && content == CalibrationContent::kCamerasAndPoints &&
        !ParseObservations(lines, &image.observations)) {
      builder->faults().Add(lines.Location().Error(lines.Peek(), "X Y POINT3D_ID"));
    }
    if (good) builder->AddImage(location, std::move(image), q);
  }
}

void ParsePoints(LineReader lines, ColmapBuilder* builder) {
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
  ColmapBuilder builder(model, faults);
  ParseCameras(LineReader(cameras, folder + "/cameras.txt"), &builder);
  ParseImages(LineReader(images, folder + "/images.txt"), content, &builder);
  if (content == CalibrationContent::kCamerasAndPoints)
    ParsePoints(LineReader(points, folder + "/points3D.txt"), &builder);
  builder.Finish();
}

}  // namespace tessera
