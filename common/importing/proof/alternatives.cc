#include "common/importing/proof/alternatives.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

// A permutation of axes with signs, and its text, such as "(x, -z, y)".
struct SignedAxes {
  Eigen::Matrix3d matrix;
  std::string name;
};

// All 48; the identity is the first.
std::vector<SignedAxes> AllSignedAxes() {
  std::vector<SignedAxes> all;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      SignedAxes axes{Eigen::Matrix3d::Zero(), "("};
      for (int row = 0; row < 3; ++row) {
        const bool negative = (signs >> row & 1) != 0;
        axes.matrix(row, order[row]) = negative ? -1 : 1;
        absl::StrAppend(&axes.name, row > 0 ? ", " : "", negative ? "-" : "", std::string(1, "xyz"[order[row]]));
      }
      axes.name += ")";
      all.push_back(std::move(axes));
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return all;
}

BlockReading OfImages(std::string name, const std::function<void(BlockImage*)>& change) {
  return {std::move(name), [change](ImportedBlock* block) {
            for (BlockImage& image : block->images) change(&image);
          }};
}

BlockReading OfLenses(std::string name, const std::function<void(LensModel*)>& change) {
  return {std::move(name), [change](ImportedBlock* block) {
            for (BlockCamera& camera : block->cameras) change(&camera.lens);
          }};
}

// `change` gets the lens of the observation's image.
BlockReading OfImagePoints(std::string name, const std::function<void(const LensModel&, Eigen::Vector2d*)>& change) {
  return {std::move(name), [change](ImportedBlock* block) {
            for (std::vector<BlockTiePoint>* points : {&block->points, &block->control_points}) {
              for (BlockTiePoint& point : *points) {
                for (BlockObservation& observation : point.observations) {
                  const int camera = block->images[static_cast<size_t>(observation.image)].camera;
                  if (camera < 0) continue;
                  change(block->cameras[static_cast<size_t>(camera)].lens, &observation.position_px);
                }
              }
            }
          }};
}

// The side, in pixels, that a focal length may be a multiple of.
double SideOf(const PinholeCamera& c, int side) {
  switch (side) {
    case 0:
      return std::max(c.width, c.height);
    case 1:
      return std::min(c.width, c.height);
    case 2:
      return c.width;
    case 3:
      return c.height;
    default:  // of 36 x 24 mm film
      return std::hypot(c.width, c.height) * 36 / std::hypot(36, 24);
  }
}
constexpr const char* kSides[] = {"longer side", "shorter side", "width", "height", "diagonal"};

}  // namespace

std::vector<BlockReading> PoseAlternatives() {
  enum class Centre { kAsRead, kIsTranslation, kWasCentre };
  std::vector<std::pair<int, BlockReading>> found;  // by the number of changes
  const std::vector<SignedAxes> all = AllSignedAxes();
  for (const bool transposed : {false, true}) {
    for (const Centre centre : {Centre::kAsRead, Centre::kIsTranslation, Centre::kWasCentre}) {
      if (transposed && centre == Centre::kWasCentre) continue;  // the same as kIsTranslation
      for (const SignedAxes& axes : all) {
        if (axes.matrix(2, 2) == 0) continue;  // a camera looks along its z axis
        std::vector<std::string> names;
        if (transposed) names.push_back("transposed rotations");
        if (centre == Centre::kIsTranslation) names.push_back("centres that are translations");
        if (centre == Centre::kWasCentre) names.push_back("translations that are centres");
        if (!axes.matrix.isIdentity()) {
          names.push_back(absl::StrCat("camera axes ", axes.name, axes.name == "(x, -y, -z)" ? " of OpenGL" : ""));
        }
        if (names.empty()) continue;
        std::string name = names[0];
        for (size_t i = 1; i < names.size(); ++i) absl::StrAppend(&name, " and ", names[i]);
        found.emplace_back(static_cast<int>(names.size()),
                           OfImages(std::move(name), [transposed, centre, matrix = axes.matrix](BlockImage* image) {
                             const Eigen::Matrix3d read = image->rotation_cam_from_block;
                             const Eigen::Matrix3d base = transposed ? read.transpose() : read;
                             image->rotation_cam_from_block = matrix * base;
                             if (centre == Centre::kIsTranslation) image->centre = -base.transpose() * image->centre;
                             if (centre == Centre::kWasCentre) image->centre = -read * image->centre;
                           }));
      }
    }
  }
  for (const SignedAxes& axes : all) {
    if (axes.matrix.isIdentity()) continue;
    found.emplace_back(1,
                       OfImages(absl::StrCat("points in the axes ", axes.name), [m = axes.matrix](BlockImage* image) {
                         image->rotation_cam_from_block = image->rotation_cam_from_block * m;
                         image->centre = m.transpose() * image->centre;
                       }));
    found.emplace_back(
        1, OfImages(absl::StrCat("rotations of the axes ", axes.name), [m = axes.matrix](BlockImage* image) {
          image->rotation_cam_from_block = image->rotation_cam_from_block * m;
        }));
    found.emplace_back(1, OfImages(absl::StrCat("centres in the axes ", axes.name),
                                   [m = axes.matrix](BlockImage* image) { image->centre = m * image->centre; }));
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<BlockReading> readings;
  for (auto& [changes, reading] : found) readings.push_back(std::move(reading));
  return readings;
}

std::vector<BlockReading> LensAlternatives() {
  std::vector<BlockReading> found;
  for (const double half : {-0.5, 0.5}) {
    found.push_back(
        OfLenses(absl::StrCat("a principal point half a pixel ", half < 0 ? "left and up" : "right and down"),
                 [half](LensModel* lens) {
                   lens->pinhole.cx += half;
                   lens->pinhole.cy += half;
                 }));
  }
  for (const double sign : {1.0, -1.0}) {
    found.push_back(OfLenses(absl::StrCat("a principal point from ", sign > 0 ? "the middle" : "the corner"),
                             [sign](LensModel* lens) {
                               lens->pinhole.cx += sign * lens->pinhole.width / 2.0;
                               lens->pinhole.cy += sign * lens->pinhole.height / 2.0;
                             }));
  }
  found.push_back(OfLenses("a principal point counted from the bottom",
                           [](LensModel* lens) { lens->pinhole.cy = lens->pinhole.height - lens->pinhole.cy; }));
  found.push_back(
      OfLenses("P1 and P2 swapped", [](LensModel* lens) { std::swap(lens->coefficients[2], lens->coefficients[3]); }));
  found.push_back(OfLenses("P1 and P2 negated", [](LensModel* lens) {
    for (const int i : {2, 3}) lens->coefficients[i] *= -1;
  }));
  found.push_back(OfLenses("P1 and P2 swapped and negated", [](LensModel* lens) {
    std::swap(lens->coefficients[2], lens->coefficients[3]);
    for (const int i : {2, 3}) lens->coefficients[i] *= -1;
  }));
  found.push_back(OfLenses("radial coefficients negated", [](LensModel* lens) {
    for (const int i : {0, 1, 4}) lens->coefficients[i] *= -1;
    if (lens->kind == LensModel::Kind::kBrown) lens->coefficients[5] *= -1;
  }));
  // From the photograph to the undistorted image.
  found.push_back(
      {"distortion the other way", [](ImportedBlock* block) {
         OfImagePoints("", [](const LensModel& lens, Eigen::Vector2d* p) { *p = lens.Distort(*p); }).apply(block);
         for (BlockCamera& camera : block->cameras) camera.lens.kind = LensModel::Kind::kPinhole;
       }});
  found.push_back(OfLenses("no distortion", [](LensModel* lens) { lens->kind = LensModel::Kind::kPinhole; }));
  found.push_back(OfLenses("skew negated", [](LensModel* lens) {
    if (lens->kind == LensModel::Kind::kBrown) lens->coefficients[6] *= -1;
  }));
  found.push_back(OfLenses("the aspect ratio inverted", [](LensModel* lens) {
    lens->pinhole.fy = lens->pinhole.fx * lens->pinhole.fx / lens->pinhole.fy;
  }));
  for (int side = 1; side < 5; ++side) {
    for (const bool inverse : {false, true}) {
      const int from = inverse ? side : 0, to = inverse ? 0 : side;
      found.push_back(OfLenses(absl::StrCat("focal lengths by the ", kSides[to], " instead of the ", kSides[from]),
                               [from, to](LensModel* lens) {
                                 PinholeCamera& c = lens->pinhole;
                                 const double factor = SideOf(c, to) / SideOf(c, from);
                                 c.fx *= factor;
                                 c.fy *= factor;
                               }));
    }
  }
  found.push_back(OfImagePoints("image points counted from the bottom", [](const LensModel& lens, Eigen::Vector2d* p) {
    p->y() = lens.pinhole.height - p->y();
  }));
  found.push_back(OfImagePoints("image points from the middle", [](const LensModel& lens, Eigen::Vector2d* p) {
    *p += Eigen::Vector2d(lens.pinhole.width / 2.0, lens.pinhole.height / 2.0);
  }));
  return found;
}

}  // namespace tessera
