// Writes a block as Metashape does, by the definitions of its manual.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

// p_world = scale rotation p_chunk + translation.
struct MetashapeWorld {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double scale = 1;
};

struct MetashapeWriteOptions {
  bool old_form = false;  // <fx>, as PhotoScan before 1.3
  MetashapeWorld component = {}, chunk = {};
  bool has_component = false, has_chunk = true;
  std::string reference = "";
  std::string frame = "";    // content of chunk/frames/frame
  bool exchanged_p = false;  // p1 and p2 in the other order
};

inline std::string MetashapeNumbers(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) absl::StrAppend(&text, text.empty() ? "" : " ", absl::StrFormat("%.17g", number));
  return text;
}

inline std::string MetashapeTransformText(const MetashapeWorld& world) {
  const Eigen::Matrix3d& r = world.rotation;
  return absl::StrCat(
      "<transform><rotation locked=\"true\">",
      MetashapeNumbers({r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)}),
      "</rotation>\n<translation>",
      MetashapeNumbers({world.translation.x(), world.translation.y(), world.translation.z()}), "</translation><scale>",
      MetashapeNumbers({world.scale}), "</scale></transform>\n");
}

// A point of the world in the coordinates of the chunk (of the component).
inline Eigen::Vector3d ChunkFromWorld(const Eigen::Vector3d& p, const MetashapeWriteOptions& options) {
  const Eigen::Vector3d q = options.chunk.rotation.transpose() * (p - options.chunk.translation) / options.chunk.scale;
  return options.component.rotation.transpose() * (q - options.component.translation) / options.component.scale;
}

inline std::string MetashapeCalibration(const LensModel& lens, const MetashapeWriteOptions& options) {
  const PinholeCamera& pinhole = lens.pinhole;
  const auto& [k1, k2, p1, p2, k3, k4, k5, k6] = lens.coefficients;
  const bool is_brown = lens.kind == LensModel::Kind::kBrown;
  std::vector<std::pair<std::string, double>> values = {{"k1", k1}, {"k2", k2}, {"k3", k3}, {"k4", is_brown ? k4 : 0}};
  const double skew = is_brown ? k5 : 0;
  const bool opencv_order = options.old_form != options.exchanged_p;
  values.insert(values.end(), {{"p1", opencv_order ? p1 : p2}, {"p2", opencv_order ? p2 : p1}});
  if (options.old_form) {
    values.insert(values.end(), {{"fx", pinhole.fx}, {"fy", pinhole.fy}, {"cx", pinhole.cx}, {"cy", pinhole.cy}});
    values.push_back({"skew", skew});
  } else {
    values.insert(values.end(), {{"f", pinhole.fy},
                                 {"b1", pinhole.fx - pinhole.fy},
                                 {"b2", skew},
                                 {"cx", pinhole.cx - pinhole.width / 2.0},
                                 {"cy", pinhole.cy - pinhole.height / 2.0}});
  }
  std::string text;
  for (const auto& [name, value] : values) absl::StrAppend(&text, absl::StrFormat("<%s>%.17g</%s>", name, value, name));
  return text;
}

// The chunk with cameras 10, 11, ... in two groups. Label: the path.
inline std::string MetashapeChunk(const ImportedBlock& block, const MetashapeWriteOptions& options) {
  std::string text = "<chunk label=\"Chunk 1\" enabled=\"true\">\n<sensors next_id=\"9\">\n";
  for (size_t k = 0; k < block.cameras.size(); ++k) {
    const LensModel& lens = block.cameras[k].lens;
    const std::string size =
        absl::StrCat("<resolution width=\"", lens.pinhole.width, "\" height=\"", lens.pinhole.height, "\"/>");
    const std::string wrong =
        options.old_form ? "<fx>1</fx><fy>1</fy><cx>0</cx><cy>0</cy>" : "<f>1</f><cx>1</cx><k1>1</k1>";
    absl::StrAppend(&text, "<sensor id=\"", k + 3, "\" label=\"", block.cameras[k].name, "\" type=\"frame\">", size,
                    "\n<calibration type=\"frame\" class=\"initial\">", size, wrong, "</calibration>\n",
                    "<calibration type=\"frame\" class=\"adjusted\">", size, MetashapeCalibration(lens, options),
                    "</calibration></sensor>\n");
  }
  text += "</sensors>\n";
  if (options.has_component) {
    absl::StrAppend(&text, "<components next_id=\"8\" active_id=\"7\"><component id=\"7\">",
                    MetashapeTransformText(options.component), "</component><component id=\"8\"/></components>\n");
  }
  text += "<cameras><group id=\"0\">\n";
  for (size_t i = 0; i < block.images.size(); ++i) {
    const BlockImage& image = block.images[i];
    const Eigen::Matrix3d r = options.component.rotation.transpose() * options.chunk.rotation.transpose() *
                              image.rotation_cam_from_block.transpose();
    const Eigen::Vector3d c = ChunkFromWorld(image.centre, options);
    absl::StrAppend(&text, "<camera id=\"", 10 + i, "\" sensor_id=\"", image.camera + 3, "\" label=\"", image.path,
                    options.has_component ? "\" component_id=\"7\">" : "\">");
    if (image.oriented) {
      absl::StrAppend(&text, "<transform>",
                      MetashapeNumbers({r(0, 0), r(0, 1), r(0, 2), c.x(), r(1, 0), r(1, 1), r(1, 2), c.y(), r(2, 0),
                                        r(2, 1), r(2, 2), c.z(), 0, 0, 0, 1}),
                      "</transform>");
    }
    absl::StrAppend(&text, "<orientation>1</orientation></camera>\n");
    if (i == block.images.size() / 2) text += "</group><group id=\"1\">";
  }
  text += "</group></cameras>\n";
  if (!options.reference.empty()) absl::StrAppend(&text, "<reference>", options.reference, "</reference>\n");
  if (!options.frame.empty()) absl::StrAppend(&text, "<frames><frame id=\"0\">", options.frame, "</frame></frames>\n");
  if (options.has_chunk) text += MetashapeTransformText(options.chunk);
  return text + "</chunk>\n";
}

inline std::string WriteMetashapeXml(const ImportedBlock& block, const MetashapeWriteOptions& options) {
  return absl::StrCat("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n",
                      MetashapeChunk(block, options), "</document>\n");
}

template <class... T>
void AppendRaw(std::string* bytes, T... values) {
  const auto append = [&](auto value) {
    char raw[sizeof(value)];
    std::memcpy(raw, &value, sizeof(value));
    bytes->append(raw, sizeof(value));
  };
  (append(values), ...);
}

// The element that names the files of tie points, and those files.
inline std::pair<std::string, std::vector<std::pair<std::string, std::string>>> WriteMetashapePoints(
    const ImportedBlock& block, const MetashapeWriteOptions& options) {
  std::string points, names = "<points path=\"points0.ply\"/>";
  for (size_t i = 0; i < block.points.size(); ++i) {
    const Eigen::Vector3f p = ChunkFromWorld(block.points[i].position, options).cast<float>();
    AppendRaw(&points, p.x(), p.y(), p.z(), static_cast<uint32_t>(5 * i + 1));
  }
  const auto header = [](size_t count, const std::string& properties) {
    return absl::StrCat("ply\nformat binary_little_endian 1.0\nelement vertex ", count, "\n", properties,
                        "end_header\n");
  };
  const std::string xyz = "property float x\nproperty float y\nproperty float z\nproperty uint id\n";
  std::vector<std::pair<std::string, std::string>> files = {{"points0.ply", header(block.points.size(), xyz) + points}};
  for (size_t k = 0; k < block.images.size(); ++k) {
    std::string rows;
    size_t count = 0;
    for (size_t i = 0; i < block.points.size(); ++i) {
      for (const BlockObservation& seen : block.points[i].observations) {
        if (seen.image != static_cast<int>(k)) continue;
        AppendRaw(&rows, static_cast<float>(seen.position_px.x()), static_cast<float>(seen.position_px.y()), 2.5f,
                  static_cast<int32_t>(5 * i + 1));
        ++count;
      }
    }
    absl::StrAppend(&names, "<projections camera_id=\"", 10 + k, "\" path=\"p", k, ".ply\"/>");
    files.push_back(
        {absl::StrCat("p", k, ".ply"),
         header(count, "property float x\nproperty float y\nproperty float size\nproperty int id\n") + rows});
  }
  return {absl::StrCat("<point_cloud>", names, "</point_cloud>"), files};
}

}  // namespace tessera
