// Writes a block as BlocksExchange, by the definitions of Bentley's page "CC Orientations".
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

struct ExchangeWriteOptions {
  std::string x_axis = "Right", y_axis = "Down";  // of CameraOrientation, directions in the image
  bool angles = false;                            // Omega, Phi, Kappa instead of a matrix
  bool millimetres = false;                       // focal length, principal point and measurements
  bool exchanged_p = false;                       // P1 and P2 as in OpenCV
  std::string block_srs = "EPSG:2154", photogroup_srs = "", tie_point_srs = "";  // empty: none
  std::string tie_point_path = "";                                               // not empty: a file of its own
};

// The part of an image's direction (x right, y down) that points to `direction`.
inline double ExchangePart(const std::string& direction, double right, double down) {
  if (direction == "Right") return right;
  if (direction == "Left") return -right;
  return direction == "Down" ? down : -down;
}

inline std::string ExchangeElement(const std::string& name, double value) {
  return absl::StrFormat("<%s>%.17g</%s>", name, value, name);
}

inline std::string ExchangeMeasurements(const ImportedBlock& block, const BlockTiePoint& point,
                                        const ExchangeWriteOptions& options, double pixel_mm) {
  std::string text;
  for (const BlockObservation& seen : point.observations) {
    const PinholeCamera& pinhole = block.cameras[block.images[seen.image].camera].lens.pinhole;
    const double right = (seen.position_px.x() - pinhole.cx) * pixel_mm;
    const double down = (seen.position_px.y() - pinhole.cy) * pixel_mm;
    absl::StrAppend(&text, "<Measurement><PhotoId>", 100 + seen.image, "</PhotoId>");
    if (options.millimetres) {
      absl::StrAppend(&text, ExchangeElement("xmm", ExchangePart(options.x_axis, right, down)),
                      ExchangeElement("ymm", ExchangePart(options.y_axis, right, down)));
    } else {
      absl::StrAppend(&text, ExchangeElement("x", seen.position_px.x() - 0.5),
                      ExchangeElement("y", seen.position_px.y() - 0.5));
    }
    absl::StrAppend(&text, "</Measurement>\n");
  }
  return text;
}

inline std::string ExchangePosition(const char* name, const Eigen::Vector3d& position) {
  return absl::StrCat("<", name, ">", ExchangeElement("x", position.x()), ExchangeElement("y", position.y()),
                      ExchangeElement("z", position.z()), "</", name, ">\n");
}

constexpr double kExchangePixel_mm = 0.0046;

inline std::string WriteExchangeTiePoints(const ImportedBlock& block, const ExchangeWriteOptions& options) {
  std::string text;
  for (const BlockTiePoint& point : block.points) {
    absl::StrAppend(&text, "<TiePoint>", ExchangePosition("Position", point.position),
                    ExchangeMeasurements(block, point, options, kExchangePixel_mm), "</TiePoint>\n");
  }
  return text;
}

inline std::string ExchangeRotation(const Eigen::Matrix3d& rotation, const ExchangeWriteOptions& options) {
  Eigen::Matrix3d rows;
  for (int column = 0; column < 3; ++column) {
    rows(0, column) = ExchangePart(options.x_axis, rotation(0, column), rotation(1, column));
    rows(1, column) = ExchangePart(options.y_axis, rotation(0, column), rotation(1, column));
  }
  rows.row(2) = rows.row(0).cross(rows.row(1));
  std::string text = "<Rotation>";
  if (options.angles) {  // rows = (Rx(omega) Ry(phi) Rz(kappa))^T
    constexpr double kDegrees = 180 / std::numbers::pi;
    absl::StrAppend(&text, ExchangeElement("Omega", kDegrees * std::atan2(-rows(2, 1), rows(2, 2))),
                    ExchangeElement("Phi", kDegrees * std::asin(rows(2, 0))),
                    ExchangeElement("Kappa", kDegrees * std::atan2(-rows(1, 0), rows(0, 0))));
  } else {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        absl::StrAppend(&text, ExchangeElement(absl::StrCat("M_", row, column), rows(row, column)));
      }
    }
  }
  return text + "</Rotation>\n";
}

// Photographs get the Ids 100, 101, ...
inline std::string WriteBlocksExchange(const ImportedBlock& block, const ExchangeWriteOptions& options) {
  std::string text = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!-- a block -->\n<BlocksExchange version=\"3.2\">\n";
  std::string systems;
  auto srs = [&, ids = 0](const std::string& definition) mutable {
    if (definition.empty()) return std::string();
    absl::StrAppend(&systems, "<SRS><Id>", ids, "</Id><Definition>", definition, "</Definition></SRS>\n");
    return absl::StrCat("<SRSId>", ids++, "</SRSId>\n");
  };
  std::string body = absl::StrCat("<Block><Name>b</Name>\n", srs(options.block_srs), "<Photogroups>\n");
  const std::string group_srs = srs(options.photogroup_srs);
  for (size_t k = 0; k < block.cameras.size(); ++k) {
    const LensModel& lens = block.cameras[k].lens;
    const PinholeCamera& pinhole = lens.pinhole;
    absl::StrAppend(&body, "<Photogroup><Name>", block.cameras[k].name, "</Name>", group_srs,
                    "<ImageDimensions><Width>", pinhole.width, "</Width><Height>", pinhole.height,
                    "</Height></ImageDimensions>\n",
                    "<CameraModelType>Perspective</CameraModelType><CameraOrientation>X", options.x_axis, "Y",
                    options.y_axis, "</CameraOrientation>\n", ExchangeElement("AspectRatio", pinhole.fy / pinhole.fx),
                    ExchangeElement("Skew", lens.kind == LensModel::Kind::kBrown ? lens.coefficients[6] : 0));
    if (options.millimetres) {
      const double right = (pinhole.cx - pinhole.width / 2.0) * kExchangePixel_mm;
      const double down = (pinhole.cy - pinhole.height / 2.0) * kExchangePixel_mm;
      absl::StrAppend(&body, ExchangeElement("SensorSize", std::max(pinhole.width, pinhole.height) * kExchangePixel_mm),
                      ExchangeElement("FocalLength", pinhole.fx * kExchangePixel_mm), "<PrincipalPoint>",
                      ExchangeElement("xmm", ExchangePart(options.x_axis, right, down)),
                      ExchangeElement("ymm", ExchangePart(options.y_axis, right, down)), "</PrincipalPoint>\n");
    } else {
      absl::StrAppend(&body, ExchangeElement("FocalLengthPixels", pinhole.fx), "<PrincipalPoint>",
                      ExchangeElement("x", pinhole.cx - 0.5), ExchangeElement("y", pinhole.cy - 0.5),
                      "</PrincipalPoint>\n");
    }
    const double* c = lens.coefficients;
    absl::StrAppend(&body, "<Distortion>", ExchangeElement("K1", c[0]), ExchangeElement("K2", c[1]),
                    ExchangeElement("K3", c[4]), ExchangeElement("P1", c[options.exchanged_p ? 2 : 3]),
                    ExchangeElement("P2", c[options.exchanged_p ? 3 : 2]), "</Distortion>\n");
    for (size_t i = 0; i < block.images.size(); ++i) {
      const BlockImage& image = block.images[i];
      if (image.camera != static_cast<int>(k)) continue;
      absl::StrAppend(&body, "<Photo><Id>", 100 + i, "</Id><ImagePath>", image.path, "</ImagePath><Component>",
                      image.component, "</Component><Pose>",
                      image.oriented ? ExchangeRotation(image.rotation_cam_from_block, options) : "",
                      ExchangePosition("Center", image.centre), "<Metadata>", ExchangePosition("Center", {1, 2, 3}),
                      "</Metadata></Pose></Photo>\n");
    }
    body += "</Photogroup>\n";
  }
  body += "</Photogroups>\n<TiePoints>" + srs(options.tie_point_srs);
  body += options.tie_point_path.empty() ? WriteExchangeTiePoints(block, options)
                                         : absl::StrCat("<Path>", options.tie_point_path, "</Path>");
  return absl::StrCat(text, "<SpatialReferenceSystems>", systems, "</SpatialReferenceSystems>\n", body,
                      "</TiePoints></Block></BlocksExchange>\n");
}

}  // namespace tessera
