#include "common/colmap/colmap_writer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <iterator>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/storage/new_file.h"

namespace tessera {
namespace {

// Appends the shortest text that is read as the same double.
void AppendNumber(std::string* line, double value) {
  char text[32];
  const auto [end, error] = std::to_chars(std::begin(text), std::end(text), value);
  line->append(text, end);
}

std::string CameraLine(uint32_t id, const LensModel& lens) {
  const PinholeCamera& camera = lens.pinhole;
  const double* k = lens.coefficients;
  // Of k1 k2 p1 p2 k3 k4 ..., the number up to the last that is not zero.
  int used = lens.kind == LensModel::Kind::kPinhole ? 0 : static_cast<int>(std::size(lens.coefficients));
  while (used > 0 && k[used - 1] == 0) --used;
  const bool is_square = camera.fx == camera.fy;
  const auto [model, coefficients] = used > 5 && lens.kind == LensModel::Kind::kBrown ? std::pair("TESSERA_BROWN", 7)
                                     : used > 4                                       ? std::pair("FULL_OPENCV", 8)
                                     : used > 2 || (used > 0 && !is_square)           ? std::pair("OPENCV", 4)
                                     : used > 1                                       ? std::pair("RADIAL", 2)
                                     : used > 0                                       ? std::pair("SIMPLE_RADIAL", 1)
                                     : is_square                                      ? std::pair("SIMPLE_PINHOLE", 0)
                                                                                      : std::pair("PINHOLE", 0);
  std::string line = absl::StrCat(id, " ", model, " ", camera.width, " ", camera.height);
  std::vector<double> parameters = {camera.fx};
  if (used > 2 || !is_square) parameters.push_back(camera.fy);
  parameters.insert(parameters.end(), {camera.cx, camera.cy});
  parameters.insert(parameters.end(), k, k + coefficients);
  for (const double parameter : parameters) {
    line += ' ';
    AppendNumber(&line, parameter);
  }
  return line + "\n";
}

std::string PoseLine(const CalibratedImage& image) {
  const Eigen::Quaterniond q(image.rotation_cam_from_world);
  const Eigen::Vector3d& t = image.translation_cam_from_world;
  std::string line = absl::StrCat(image.id);
  for (const double number : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
    line += ' ';
    AppendNumber(&line, number);
  }
  absl::StrAppend(&line, " ", image.camera_id, " ", image.name, "\n");
  return line;
}

// The reader takes the rest of a line as the name, without blanks at its ends.
Status CheckName(const std::string& name) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  if (!name.empty() && name.find_first_of("\r\n") == std::string::npos && !is_blank(name.front()) &&
      !is_blank(name.back())) {
    return absl::OkStatus();
  }
  return InputError("images.txt", "", absl::StrCat("the image name '", name, "'"),
                    "a name without line breaks, and without blanks at its ends");
}

struct TrackEntry {
  uint32_t image_id = 0, index = 0;  // of the image point in its image
};

// The entries of the track of point i: [first[i], first[i + 1]).
struct Tracks {
  std::vector<uint64_t> first;
  std::vector<TrackEntry> entries;
};

StatusOr<Tracks> TracksOf(const CalibratedImages& model) {
  std::unordered_map<uint64_t, size_t> index_of;
  index_of.reserve(model.points.size());
  for (size_t i = 0; i < model.points.size(); ++i) index_of.emplace(model.points[i].id, i);
  Tracks tracks;
  tracks.first.assign(model.points.size() + 1, 0);
  for (const CalibratedImage& image : model.images) {
    for (const ImageObservation& observation : image.observations) {
      const auto point = index_of.find(observation.point_id);
      if (point == index_of.end()) {
        return InputError("images.txt", absl::StrCat("image '", image.name, "'"),
                          absl::StrCat("an observation of point ", observation.point_id), "a point of the model");
      }
      ++tracks.first[point->second + 1];
    }
  }
  for (size_t i = 0; i < model.points.size(); ++i) tracks.first[i + 1] += tracks.first[i];
  tracks.entries.resize(tracks.first.back());
  std::vector<uint64_t> next(tracks.first.begin(), tracks.first.end() - 1);
  for (const CalibratedImage& image : model.images) {
    for (size_t k = 0; k < image.observations.size(); ++k) {
      tracks.entries[next[index_of.at(image.observations[k].point_id)]++] = {image.id, static_cast<uint32_t>(k)};
    }
  }
  return tracks;
}

}  // namespace

Status WriteColmapModel(const CalibratedImages& model, const std::string& folder) {
  for (const CalibratedImage& image : model.images) TESSERA_RETURN_IF_ERROR(CheckName(image.name));
  TESSERA_ASSIGN_OR_RETURN(const Tracks tracks, TracksOf(model));
  NewFile cameras(folder + "/cameras.txt"), images(folder + "/images.txt"), points(folder + "/points3D.txt");
  cameras.Add("# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
  for (const auto& [id, lens] : model.cameras) cameras.Add(CameraLine(id, lens));

  images.Add(
      "# Image list, two lines each: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME and POINTS2D[] as "
      "(X, Y, POINT3D_ID)\n");
  std::string text;
  for (const CalibratedImage& image : model.images) {
    images.Add(PoseLine(image));
    for (size_t k = 0; k < image.observations.size(); ++k) {
      const ImageObservation& observation = image.observations[k];
      text.clear();
      if (k > 0) text += ' ';
      AppendNumber(&text, observation.position_px.x());
      text += ' ';
      AppendNumber(&text, observation.position_px.y());
      absl::StrAppend(&text, " ", observation.point_id);
      images.Add(text);
    }
    images.Add("\n");
  }

  points.Add("# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
  for (size_t i = 0; i < model.points.size(); ++i) {
    text = absl::StrCat(model.points[i].id);
    for (const double coordinate : model.points[i].position) {
      text += ' ';
      AppendNumber(&text, coordinate);
    }
    text += " 128 128 128 -1";
    for (uint64_t e = tracks.first[i]; e < tracks.first[i + 1]; ++e) {
      absl::StrAppend(&text, " ", tracks.entries[e].image_id, " ", tracks.entries[e].index);
    }
    text += '\n';
    points.Add(text);
  }
  TESSERA_RETURN_IF_ERROR(cameras.Finish());
  TESSERA_RETURN_IF_ERROR(images.Finish());
  return points.Finish();
}

}  // namespace tessera
