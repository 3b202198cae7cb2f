#include "common/blocks/block_parts.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera {
namespace {

constexpr double kMaxRotationError = 1e-3;

}  // namespace

void SetBrownLens(const BrownLens& brown, LensModel* lens) {
  using Kind = LensModel::Kind;
  const auto& [k1, k2, k3, k4, p1, p2, skew_px] = brown;
  const bool is_radial = p1 == 0 && p2 == 0 && lens->pinhole.fx == lens->pinhole.fy;
  lens->kind = k4 != 0 || skew_px != 0                    ? Kind::kBrown
               : k3 != 0                                  ? Kind::kFullOpenCv
               : k1 == 0 && k2 == 0 && p1 == 0 && p2 == 0 ? Kind::kPinhole
               : !is_radial                               ? Kind::kOpenCv
               : k2 != 0                                  ? Kind::kRadial
                                                          : Kind::kSimpleRadial;
  const double coefficients[8] = {k1, k2, p1, p2, k3, k4, skew_px, 0};
  std::copy(std::begin(coefficients), std::end(coefficients), lens->coefficients);
}

BlockReading ExchangedTangentialReading() {
  return {"p1 and p2 exchanged", [](ImportedBlock* block) {
            for (BlockCamera& camera : block->cameras)
              std::swap(camera.lens.coefficients[2], camera.lens.coefficients[3]);
          }};
}

bool HasTangential(const ImportedBlock& block) {
  return std::any_of(block.cameras.begin(), block.cameras.end(), [](const BlockCamera& camera) {
    return camera.lens.coefficients[2] != 0 || camera.lens.coefficients[3] != 0;
  });
}

bool MakeRotation(Eigen::Matrix3d* rotation) {
  const Eigen::Matrix3d error = *rotation * rotation->transpose() - Eigen::Matrix3d::Identity();
  if (!(error.cwiseAbs().maxCoeff() <= kMaxRotationError && rotation->determinant() > 0)) return false;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(*rotation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  *rotation = svd.matrixU() * svd.matrixV().transpose();
  return true;
}

int64_t DropUnorientedObservations(const ImportedBlock& block, std::vector<BlockTiePoint>* points) {
  int64_t dropped = 0;
  for (BlockTiePoint& point : *points) {
    dropped += static_cast<int64_t>(std::erase_if(
        point.observations, [&](const BlockObservation& seen) { return !block.images[seen.image].oriented; }));
  }
  std::erase_if(*points, [](const BlockTiePoint& point) { return point.observations.empty(); });
  return dropped;
}

void ChooseComponent(int wanted, const std::string& path, ImportedBlock* block, Faults* faults) {
  std::map<int, int> images_of;
  for (const BlockImage& image : block->images) {
    if (image.oriented) ++images_of[image.component];
  }
  if (images_of.empty()) {
    if (faults->empty()) {
      faults->Add(InputError(path, "", absl::StrCat("no pose among ", block->images.size(), " images"),
                             "a block that was aligned before its export"));
    }
    return;
  }
  int chosen = wanted;
  if (wanted < 0) {
    chosen = std::max_element(images_of.begin(), images_of.end(), [](const auto& a, const auto& b) {
               return std::pair(a.first >= 0, a.second) < std::pair(b.first >= 0, b.second);
             })->first;
  } else if (!images_of.contains(wanted)) {
    const std::string known = absl::StrJoin(images_of, ", ", [](std::string* out, const auto& entry) {
      absl::StrAppend(out, entry.first, " (", entry.second, " images)");
    });
    faults->Add(InputError(path, "", absl::StrCat("no oriented image of component ", wanted),
                           absl::StrCat("--component with one of ", known)));
    return;
  }
  int others = 0;
  for (BlockImage& image : block->images) {
    if (!image.oriented || image.component == chosen) continue;
    image.oriented = false;
    ++others;
  }
  if (others > 0) {
    block->left_out.push_back(absl::StrCat("the poses of ", others, " images of other components than ", chosen, " (",
                                           images_of[chosen], " images): --component chooses another"));
  }
}

LensModel MakeBrownLens(const PinholeCamera& pinhole, const std::array<double, 4>& radial, double p1, double p2,
                        double skew_px) {
  LensModel lens;
  lens.pinhole = pinhole;
  SetBrownLens({radial[0], radial[1], radial[2], radial[3], p1, p2, skew_px}, &lens);
  return lens;
}

Status ImageSizeFault(const std::string& file, const std::string& location, const std::string& path,
                      const Status& error, ImportedBlock* block) {
  if (absl::IsNotFound(error)) block->missing_images.push_back(path);
  return InputError(file, location, std::string(error.message()),
                    "one image file, because the format states no image size: say where by --images or --image-path");
}

int SharedCameras::IndexOf(const LensModel& lens, const std::string& name) {
  std::array<double, 15> key;
  const PinholeCamera& p = lens.pinhole;
  const double head[7] = {static_cast<double>(lens.kind),
                          static_cast<double>(p.width),
                          static_cast<double>(p.height),
                          p.fx,
                          p.fy,
                          p.cx,
                          p.cy};
  std::copy(std::begin(head), std::end(head), key.begin());
  std::copy(std::begin(lens.coefficients), std::end(lens.coefficients), key.begin() + 7);
  const auto [it, is_new] = indices_.emplace(key, static_cast<int>(block_.cameras.size()));
  if (is_new) block_.cameras.push_back({name, lens});
  return it->second;
}

std::string_view WithoutByteOrderMark(std::string_view text) {
  return text.starts_with("\xef\xbb\xbf") ? text.substr(3) : text;
}

}  // namespace tessera
