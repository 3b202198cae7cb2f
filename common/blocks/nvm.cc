// Conventions, from http://ccwu.me/vsfm/doc.html#nvm, PBA's reader (util.h), COLMAP's ExportNVM and OpenSfM's
// export_visualsfm.py:
//   NVM_V3 [FixedK fx cx fy cy [r]]
//   models: number of images, their lines, number of points, their lines; a model of 0 images ends the list. A last
//     model without points lists the images that were not oriented.
//   image: name, focal length (pixels), quaternion WXYZ from the world to the camera, centre, radial distortion, 0. In
//     NVM_V3_R9T a rotation matrix, row by row, and the translation -R C stand for quaternion and centre.
//   point: X Y Z, R G B, number of observations, each: index of the image in the model, of the feature, x, y.
// The camera's axes are x right, y down, z forward. The principal point is the middle of the image or that of FixedK.
// What x, y and the radial distortion r mean is not stated in the file and differs:
//   VisualSFM: x, y from the principal point; undistorted = (1 + r d^2) distorted, d the distorted distance over f.
//   COLMAP: x, y from the image's upper left corner; distorted = (1 - r d^2) undistorted, d the undistorted distance.
//   OpenSfM: r is 0, images are undistorted; distances from the middle are scaled by width and height instead of the
//     larger of both, and added to the middle, from the corner.
#include "common/blocks/nvm.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>

#include "absl/strings/str_cat.h"
#include "common/blocks/block_parts.h"
#include "common/colmap/colmap_lines.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr double kMaxFitResidual_px = 0.01;
constexpr size_t kMaxNvmFaults = 200;  // more mean that the file is no NVM

struct NvmFixedLens {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  std::optional<double> radial;
};

struct NvmImage {
  BlockImage image;  // without camera
  double focal_px = 0, radial = 0;
};

struct NvmModel {
  std::vector<NvmImage> images;
  std::map<std::string, int64_t> lines_of_names;
  std::vector<BlockTiePoint> points;
};

// VisualSFM quotes names with blanks, or writes a quotation mark for each blank.
std::string NvmImageName(std::string name) {
  if (name.size() > 2 && name.front() == '"' && name.back() == '"') name = name.substr(1, name.size() - 2);
  std::replace(name.begin(), name.end(), '"', ' ');
  return name;
}

class NvmParser {
 public:
  NvmParser(const std::string& text, const std::string& name, Faults* faults)
      : size_bytes_(text.size()), lines_(text, name), name_(name), faults_(*faults) {}

  // False after a fault that makes the rest meaningless.
  bool ReadAll() {
    if (!ReadHeader()) return false;
    while (true) {
      int64_t images = 0;
      if (!ReadCount("images", 20, models_.empty(), &images)) return false;
      if (images == 0) return true;
      NvmModel& model = models_.emplace_back();
      for (int64_t i = 0; i < images; ++i) {
        if (!NextLine("image", i, images)) return false;
        ReadImage(model);
      }
      int64_t points = 0;
      if (!ReadCount("points", 14, false, &points)) return false;
      for (int64_t i = 0; i < points; ++i) {
        if (!NextLine("point", i, points)) return false;
        ReadPoint(model, images);
      }
    }
  }

  const std::string& version() const { return version_; }
  const std::optional<NvmFixedLens>& fixed_lens() const { return fixed_lens_; }
  std::vector<NvmModel>& models() { return models_; }

 private:
  void Fault(const std::string& found, const std::string& expected) {
    faults_.Add(InputError(name_, absl::StrCat("line ", lines_.number()), found, expected));
  }

  bool ReadHeader() {
    const bool has_line = lines_.Next();
    version_ = has_line ? lines_.Word() : "";
    if (version_ != "NVM_V3" && version_ != "NVM_V3_R9T") {
      Fault(has_line ? Quoted(version_) : "an empty file", "NVM_V3 or NVM_V3_R9T");
      return false;
    }
    if (lines_.AtEnd()) return true;
    NvmFixedLens lens;
    double radial = 0;
    if (lines_.Word() != "FixedK" || !lines_.Number(&lens.fx) || !lines_.Number(&lens.cx) || !lines_.Number(&lens.fy) ||
        !lines_.Number(&lens.cy) || !(lens.fx > 0) || !(lens.fy > 0) || !std::isfinite(lens.fx + lens.fy) ||
        !std::isfinite(lens.cx + lens.cy)) {
      Fault("another header", "NVM_V3 alone or with FixedK fx cx fy cy and an optional radial distortion");
      return false;
    }
    if (lines_.Number(&radial) && std::isfinite(radial)) lens.radial = radial;
    fixed_lens_ = lens;
    return true;
  }

  // The number of entries that follow, each of at least `entry_bytes`. The end of the file is a count of 0, unless it
  // is `required`.
  bool ReadCount(const std::string& what, size_t entry_bytes, bool required, int64_t* count) {
    if (!lines_.NextEntry()) {
      if (what == "images" && !required) return true;
      Fault("the end of the file", absl::StrCat("the number of ", what));
      return false;
    }
    const std::string found = lines_.Peek();
    if (!lines_.Number(count) || *count < 0 || !lines_.AtEnd()) {
      Fault(found, absl::StrCat("the number of ", what));
      return false;
    }
    if (static_cast<uint64_t>(*count) > size_bytes_ / entry_bytes) {
      Fault(absl::StrCat(*count, " ", what), absl::StrCat("no more than a file of ", size_bytes_, " bytes can have"));
      return false;
    }
    return true;
  }

  bool NextLine(const std::string& what, int64_t index, int64_t count) {
    if (faults_.messages().size() > kMaxNvmFaults) return false;
    if (lines_.NextEntry()) return true;
    Fault("the end of the file", absl::StrCat(what, " ", index + 1, " of ", count));
    return false;
  }

  void ReadImage(NvmModel& model) {
    // Names may contain blanks: the numbers are the last words.
    const bool has_matrix = version_ == "NVM_V3_R9T";
    const int numbers = has_matrix ? 15 : 10;
    std::string line = lines_.Rest();
    std::vector<double> values(numbers);
    for (int k = numbers; k-- > 0;) {
      while (!line.empty() && IsBlank(line.back())) line.pop_back();
      const size_t blank = line.find_last_of(" \t");
      const std::string word = blank == std::string::npos ? "" : line.substr(blank + 1);
      if (!ParseNumber(word, values[k]) || !std::isfinite(values[k])) {
        return Fault(word.empty() ? "a shorter line" : Quoted(word),
                     absl::StrCat("a name and ", numbers, " numbers of an image"));
      }
      line.resize(blank);
    }
    while (!line.empty() && IsBlank(line.back())) line.pop_back();
    NvmImage entry;
    entry.image.path = NvmImageName(line);
    entry.image.location = absl::StrCat("line ", lines_.number());
    entry.focal_px = values[0];
    entry.radial = values[numbers - 2];
    const auto [it, is_new] = model.lines_of_names.emplace(entry.image.path, lines_.number());
    if (entry.image.path.empty()) {
      Fault("no name", "the name of an image");
    } else if (!is_new) {
      Fault(absl::StrCat("image ", entry.image.path, " again"), absl::StrCat("one line; line ", it->second, " has it"));
    }
    if (!(entry.focal_px > 0)) Fault(absl::StrCat(entry.focal_px), "a focal length above 0");
    Eigen::Matrix3d& rotation = entry.image.rotation_cam_from_block;
    const Eigen::Vector3d last(values[numbers - 5], values[numbers - 4], values[numbers - 3]);
    if (has_matrix) {
      for (int k = 0; k < 9; ++k) rotation(k / 3, k % 3) = values[1 + k];
      if (!MakeRotation(&rotation)) Fault("a matrix that is no rotation", "a rotation from the world to the camera");
      entry.image.centre = -rotation.transpose() * last;
      if (!entry.image.centre.allFinite()) Fault("a translation too large", "finite coordinates of the centre");
    } else {
      Eigen::Quaterniond q(values[1], values[2], values[3], values[4]);
      if (!(std::abs(q.squaredNorm() - 1) <= 1e-3)) {
        Fault(absl::StrCat("a quaternion of length ", q.norm()), "a quaternion of length 1");
      }
      rotation = q.normalized().toRotationMatrix();
      entry.image.centre = last;
    }
    model.images.push_back(std::move(entry));
  }

  void ReadPoint(NvmModel& model, int64_t images) {
    BlockTiePoint point;
    double colour = 0;
    int64_t observations = 0;
    bool good = true;
    for (int k = 0; k < 3; ++k) good = good && lines_.Number(&point.position[k]);
    for (int k = 0; k < 3; ++k) good = good && lines_.Number(&colour);
    if (!good || !point.position.allFinite() || !lines_.Number(&observations) || observations < 0) {
      return Fault(lines_.Peek(), "X Y Z, R G B and the number of observations of a point");
    }
    for (int64_t k = 0; k < observations; ++k) {
      int64_t image = 0;
      double feature = 0;
      BlockObservation observation;
      if (!lines_.Number(&image) || !lines_.Number(&feature) || !lines_.Number(&observation.position_px.x()) ||
          !lines_.Number(&observation.position_px.y()) || !observation.position_px.allFinite()) {
        return Fault(lines_.Peek(), absl::StrCat("observation ", k + 1, " of ", observations, ": image feature x y"));
      }
      if (image < 0 || image >= images) {
        return Fault(absl::StrCat("image ", image), absl::StrCat("an index below ", images));
      }
      observation.image = static_cast<int>(image);
      point.observations.push_back(observation);
    }
    if (!lines_.AtEnd()) return Fault(lines_.Peek(), absl::StrCat("the end of ", observations, " observations"));
    model.points.push_back(std::move(point));
  }

  const size_t size_bytes_;
  ColmapLineReader lines_;
  const std::string name_;
  Faults& faults_;
  std::string version_;
  std::optional<NvmFixedLens> fixed_lens_;
  std::vector<NvmModel> models_;
};

// The index of the model to read; -1 after a fault. Adds the others to `left_out`.
int ChooseNvmModel(const std::vector<NvmModel>& models, const std::string& name, int component, ImportedBlock* block,
                   Faults* faults) {
  const int count = static_cast<int>(models.size());
  if (component >= count || count == 0) {
    faults->Add(InputError(name, "", absl::StrCat(count, " models"),
                           count == 0 ? "a model with images" : absl::StrCat("model ", component, ", counted from 0")));
    return -1;
  }
  int chosen = std::max(component, 0);
  for (int m = 0; component < 0 && m < count; ++m) {
    const auto rank = [&](int i) { return std::pair(!models[i].points.empty(), models[i].images.size()); };
    if (rank(m) > rank(chosen)) chosen = m;
  }
  for (int m = 0; m < count; ++m) {
    if (m == chosen) continue;
    const size_t images = models[m].images.size(), points = models[m].points.size();
    block->left_out.push_back(
        points == 0 ? absl::StrCat("model ", m, ": ", images, " images without points, which were not oriented")
                    : absl::StrCat("model ", m, ": ", images, " images and ", points,
                                   " points in a coordinate system of their own; --component ", m, " reads them"));
  }
  return chosen;
}

void AddNvmReadings(const std::vector<double>& radial_of_camera, bool is_fixed, ImportedBlock* block) {
  std::vector<LensModel> lenses;
  bool is_distorted = false, is_square = true;
  for (size_t c = 0; c < block->cameras.size(); ++c) {
    const PinholeCamera& pinhole = block->cameras[c].lens.pinhole;
    is_distorted = is_distorted || radial_of_camera[c] != 0;
    is_square = is_square && pinhole.width == pinhole.height;
    const std::optional<LensModel> lens = LensOfInverseRadial(pinhole, radial_of_camera[c]);
    if (!lens.has_value()) {
      block->left_out.push_back(absl::StrCat("the reading of VisualSFM: no forward distortion is within ",
                                             kMaxFitResidual_px, " px of radial distortion ", radial_of_camera[c]));
      lenses.clear();
      break;
    }
    lenses.push_back(*lens);
  }
  if (!lenses.empty()) {
    block->readings.push_back(
        {"VisualSFM's NVM: positions from the principal point, inverse radial distortion", [lenses](ImportedBlock* b) {
           for (size_t c = 0; c < lenses.size(); ++c) b->cameras[c].lens = lenses[c];
           for (BlockTiePoint& point : b->points) {
             for (BlockObservation& o : point.observations) {
               const PinholeCamera& p = lenses[b->images[o.image].camera].pinhole;
               o.position_px += Eigen::Vector2d(p.cx, p.cy);
             }
           }
         }});
  }
  if (is_distorted || is_square || is_fixed) return;
  block->readings.push_back(
      {"OpenSfM's NVM: distances from the middle scaled by the width and the height", [](ImportedBlock* b) {
         for (BlockTiePoint& point : b->points) {
           for (BlockObservation& o : point.observations) {
             const PinholeCamera& p = b->cameras[b->images[o.image].camera].lens.pinhole;
             const Eigen::Vector2d size(p.width, p.height), middle = size / 2;
             o.position_px = middle + size.maxCoeff() * (o.position_px - middle).cwiseQuotient(size);
           }
         }
       }});
}

}  // namespace

std::optional<LensModel> LensOfInverseRadial(const PinholeCamera& pinhole, double k) {
  double largest = 0;  // distorted distance of a corner, over the focal length
  for (const double x : {0.0, static_cast<double>(pinhole.width)}) {
    for (const double y : {0.0, static_cast<double>(pinhole.height)}) {
      largest = std::max(largest, std::hypot((x - pinhole.cx) / pinhole.fx, (y - pinhole.cy) / pinhole.fy));
    }
  }
  if (!(1 + 3 * k * largest * largest > 0.05)) return std::nullopt;
  if (k == 0) return MakeBrownLens(pinhole, {}, 0, 0);
  constexpr int kSamples = 200;
  const Eigen::ArrayXd distorted = Eigen::ArrayXd::LinSpaced(kSamples, 0, largest);
  const Eigen::ArrayXd undistorted = distorted * (1 + k * distorted.square());
  const double scale = undistorted[kSamples - 1];  // keeps the columns of the fit of one size
  const Eigen::ArrayXd squared = (undistorted / scale).square();
  // Terms of the numerator and the denominator. distorted (1 + denominator) = undistorted (1 + numerator) is linear.
  for (const auto& [above, below] : {std::pair(1, 0), {2, 0}, {3, 0}, {2, 2}, {3, 3}}) {
    Eigen::MatrixXd columns(kSamples, above + below);
    for (int t = 0; t < above; ++t) columns.col(t) = undistorted * squared.pow(t + 1);
    for (int t = 0; t < below; ++t) columns.col(above + t) = -distorted * squared.pow(t + 1);
    const Eigen::VectorXd fit = columns.colPivHouseholderQr().solve((distorted - undistorted).matrix());
    std::array<double, 6> terms = {};
    for (int t = 0; t < above; ++t) terms[t] = fit[t] / std::pow(scale, 2 * t + 2);
    for (int t = 0; t < below; ++t) terms[3 + t] = fit[above + t] / std::pow(scale, 2 * t + 2);
    LensModel lens = MakeBrownLens(pinhole, {terms[0], terms[1], terms[2], 0}, 0, 0);
    if (below > 0) {
      lens.kind = LensModel::Kind::kFullOpenCv;
      std::copy(terms.begin() + 3, terms.end(), lens.coefficients + 5);
    }
    double worst_px = 0;
    for (int i = 0; i < kSamples; ++i) {
      const Eigen::Vector2d centre(pinhole.cx, pinhole.cy), along(pinhole.fx, 0);
      const double error_px = (lens.Distort(centre + undistorted[i] * along) - centre - distorted[i] * along).norm() *
                              std::max(1.0, pinhole.fy / pinhole.fx);
      worst_px = error_px <= worst_px ? worst_px : error_px;  // also NaN
    }
    if (worst_px <= kMaxFitResidual_px) return lens;
  }
  return std::nullopt;
}

ImportedBlock ParseNvm(const std::string& text, const std::string& name, const PhotographSize& size_of,
                       const BlockReadOptions& options, Faults* faults) {
  ImportedBlock block;
  NvmParser parser(text, name, faults);
  const bool is_whole = parser.ReadAll();
  block.version = parser.version();
  const int chosen = is_whole ? ChooseNvmModel(parser.models(), name, options.component, &block, faults) : -1;
  if (chosen < 0) return block;
  NvmModel& model = parser.models()[chosen];
  SharedCameras cameras(&block);
  std::vector<double> radial_of_camera;
  for (NvmImage& entry : model.images) {
    const StatusOr<ImageSize> size = size_of(entry.image.path);
    if (!size.ok()) {
      faults->Add(ImageSizeFault(name, entry.image.location, entry.image.path, size.status(), &block));
      continue;
    }
    const std::optional<NvmFixedLens>& fixed = parser.fixed_lens();
    PinholeCamera pinhole{size->width,    size->height,      entry.focal_px,
                          entry.focal_px, size->width / 2.0, size->height / 2.0};
    double radial = entry.radial;
    if (fixed.has_value()) {
      pinhole = {size->width, size->height, fixed->fx, fixed->fy, fixed->cx, fixed->cy};
      if (fixed->radial.has_value() && radial != 0 && radial != *fixed->radial) {
        faults->Add(InputError(name, entry.image.location, absl::StrCat("radial distortion ", radial),
                               absl::StrCat(*fixed->radial, " of FixedK, or 0")));
      }
      radial = fixed->radial.value_or(radial);
    }
    const size_t before = block.cameras.size();
    entry.image.camera = cameras.IndexOf(MakeBrownLens(pinhole, {-radial}, 0, 0), entry.image.path);
    if (block.cameras.size() > before) radial_of_camera.push_back(radial);
    block.images.push_back(std::move(entry.image));
  }
  if (!faults->empty()) return block;
  block.points = std::move(model.points);
  AddNvmReadings(radial_of_camera, parser.fixed_lens().has_value(), &block);
  block.conventions = {"NVM: the quaternion rotates from the world to the camera, the position is the camera's centre.",
                       parser.fixed_lens().has_value()
                           ? "NVM: all images have the focal lengths and the principal point of FixedK."
                           : "NVM: the principal point is the middle of the image.",
                       "NVM as COLMAP writes it: positions from the upper left corner, radial distortion forward with "
                       "its sign changed."};
  return block;
}

bool IsNvm(const std::string& path) {
  const StatusOr<std::string> start = ReadFileRange(path, 0, 16);
  return start.ok() && WithoutByteOrderMark(*start).starts_with("NVM_V3");
}

ImportedBlock ReadNvm(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings*) {
  ImportedBlock block;
  const StatusOr<std::string> text = ReadFile(path);
  if (!text.ok()) {
    faults->Add(text.status());
    return block;
  }
  PhotographFiles files(path, options.photographs);
  block = ParseNvm(
      *text, path, [&files](const std::string& image) { return files.SizeOf(image); }, options, faults);
  block.files = {AbsolutePath(path)};
  return block;
}

}  // namespace tessera
