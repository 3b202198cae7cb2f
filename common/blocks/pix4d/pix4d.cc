// Conventions, from the header of the file itself and Pix4D's help, "How are the Internal and External Camera
// Parameters defined?" (202559089) and "What does the Output Params Folder contain?" (202977149):
//   m = K [R | -R t] X: R from the world to the camera, whose axes are x right, y down, z forward; t the centre.
//   X is in the output coordinate system, less the offset of offset.xyz. The adjustment takes a map projection as
//   Cartesian.
//   Pixels: K's principal point counts from the image's upper left corner.
//   Distortion: R1, R2, R3 of r^2, r^4, r^6; x + 2 T1 x y + T2 (r^2 + 2 x^2), y + 2 T2 x y + T1 (r^2 + 2 y^2), which is
//   OpenCV's p1, p2. All apply to the undistorted position.
// Fisheye lenses have other lines, which are refused.
#include "common/blocks/block_parts.h"
#include "common/blocks/pix4d/pix4d.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "common/blocks/photograph_files.h"
#include "common/blocks/pix4d/pix4d_tie_points.h"
#include "common/colmap/colmap_lines.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr std::array<const char*, 7> kPix4dHeader = {"fileName imageWidth imageHeight", "camera matrix K [3x3]",
                                                     "radial distortion [3x1]",         "tangential distortion [2x1]",
                                                     "camera position t [3x1]",         "camera rotation R [3x3]",
                                                     "camera model m = K [R|-Rt] X"};
constexpr int64_t kMaxPix4dFile_bytes = int64_t{1} << 30;
// Pix4D writes projection matrices with six decimals: up to .11 pixels in a real block.
constexpr double kMaxMatrixDifference_px = 1, kMaxOffsetSpread = 0.01;

// The numbers of the next line, exactly N; false and a fault if they are not there.
template <size_t N>
bool ReadPix4dRow(ColmapLineReader& lines, const char* what, std::array<double, N>& row, Faults* faults) {
  const bool has_line = lines.Next();
  bool good = has_line;
  double sum = 0;
  for (double& value : row) {
    good = good && lines.Number(&value);
    if (good) sum += value;
  }
  if (good && lines.AtEnd() && std::isfinite(sum)) return true;
  faults->Add(lines.Location().Error(
      has_line ? good ? "more words or a number that is not finite" : lines.Peek() : "the end of the file",
      absl::StrCat(N, " numbers: ", what)));
  return false;
}

bool ReadPix4dMatrix(ColmapLineReader& lines, const char* what, Eigen::Matrix3d& matrix, Faults* faults) {
  for (int r = 0; r < 3; ++r) {
    std::array<double, 3> row;
    if (!ReadPix4dRow(lines, what, row, faults)) return false;
    matrix.row(r) << row[0], row[1], row[2];
  }
  return true;
}

// The lens of a camera matrix and Pix4D's distortion; a fault if the matrix is none.
bool Pix4dLens(const Eigen::Matrix3d& k, const std::array<double, 3>& radial, const std::array<double, 2>& tangential,
               int width, int height, LensModel& lens) {
  if (!(k(0, 0) > 0) || !(k(1, 1) > 0) || k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1) return false;
  lens = MakeBrownLens({width, height, k(0, 0), k(1, 1), k(0, 2), k(1, 2)}, {radial[0], radial[1], radial[2], 0},
                   tangential[0], tangential[1], k(0, 1));
  return true;
}

bool ReadPix4dHeader(ColmapLineReader& lines, Faults* faults) {
  for (const char* expected : kPix4dHeader) {
    const std::string found = lines.Next() ? lines.Rest() : "";
    if (found == expected) continue;
    faults->Add(lines.Location().Error(
        found.empty() ? "no header" : Quoted(found),
        absl::StrCat("'", expected,
                     "'; of Pix4D's lenses the perspective one is read, fisheye and spherical are not")));
    return false;
  }
  return true;
}

// The name of the file of `folder` that ends with `suffix`: the one with this prefix, or else the only one. Empty if
// there is none.
std::string Pix4dCompanion(const std::string& folder, const std::string& prefix, const std::string& suffix,
                           Warnings* warnings) {
  const std::string same = absl::StrCat(folder, "/", prefix, suffix);
  if (FileExists(same)) return same;
  std::vector<std::string> others;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().filename().string().ends_with(suffix)) others.push_back(entry.path().string());
  }
  if (others.size() > 1) {
    warnings->push_back(absl::StrCat(folder, ": ", others.size(), " files *", suffix, ", none of them ", prefix, suffix,
                                     "; none is read"));
  }
  return others.size() == 1 ? others[0] : "";
}

bool HasPix4dHeader(const std::string& path) {
  const StatusOr<std::string> start = ReadFileRange(path, 0, 512);
  return start.ok() && WithoutByteOrderMark(*start).starts_with(kPix4dHeader[0]) &&
         start->find("camera model m = K") != std::string::npos;
}

// The camera parameter files of a folder, a project's folder, or `path` itself.
std::vector<std::string> Pix4dCameraFiles(const std::string& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    return HasPix4dHeader(path) ? std::vector<std::string>{path} : std::vector<std::string>{};
  }
  std::vector<std::string> files;
  for (const char* inside : {"", "/params", "/1_initial/params"}) {
    for (const fs::directory_entry& entry : fs::directory_iterator(path + inside, error)) {
      if (entry.path().extension() == ".txt" && HasPix4dHeader(entry.path().string())) {
        files.push_back(entry.path().string());
      }
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

void ReadPix4dOffset(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults) {
  const std::string spaced = absl::StrReplaceAll(text, {{",", " "}});
  ColmapLineReader lines(spaced, name);
  std::array<double, 3> row = {};
  if (ReadPix4dRow(lines, "the offset of coordinates", row, faults)) block->offset << row[0], row[1], row[2];
}

void ReadPix4dSystem(std::string text, const std::string& name, ImportedBlock* block) {
  text = std::string(absl::StripAsciiWhitespace(std::string(WithoutByteOrderMark(text))));
  if (text.starts_with("LOCAL_CS") || text.starts_with("ENGCRS") || text.empty()) {
    block->left_out.push_back(absl::StrCat(name, ": a local coordinate system"));
    return;
  }
  block->crs = text;
}

}  // namespace

void ParsePix4dCameras(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults) {
  ColmapLineReader lines(text, name);
  if (!ReadPix4dHeader(lines, faults)) return;
  SharedCameras cameras(block);
  std::map<std::string, int64_t> lines_of_names;
  while (lines.NextEntry()) {
    // The name may contain blanks; the last two words are numbers.
    const int64_t first_line = lines.number();
    std::string line = lines.Rest();
    int64_t size[2] = {};
    bool good = true;
    for (int k = 2; k-- > 0 && good;) {
      while (!line.empty() && IsBlank(line.back())) line.pop_back();
      const size_t blank = line.find_last_of(" \t");
      good = blank != std::string::npos && ParseInteger(line.substr(blank + 1), size[k]) && size[k] > 0 &&
             size[k] < 1'000'000;
      if (good) line.resize(blank);
    }
    while (!line.empty() && IsBlank(line.back())) line.pop_back();
    const auto fault = [&](const std::string& found, const std::string& expected) {
      faults->Add(InputError(name, absl::StrCat("line ", first_line), found, expected));
    };
    // What follows is not read if lines are missing: which line is which image's is then unknown.
    if (!good || line.empty()) return fault(Quoted(line), "an image: name, width and height");
    Eigen::Matrix3d k, rotation;
    std::array<double, 3> radial, position;
    std::array<double, 2> tangential;
    if (!ReadPix4dMatrix(lines, "a row of the camera matrix", k, faults) ||
        !ReadPix4dRow(lines, "radial distortion", radial, faults) ||
        !ReadPix4dRow(lines, "tangential distortion", tangential, faults) ||
        !ReadPix4dRow(lines, "the camera's position", position, faults) ||
        !ReadPix4dMatrix(lines, "a row of the rotation", rotation, faults)) {
      return;
    }
    const auto [it, is_new] = lines_of_names.emplace(line, first_line);
    if (!is_new) fault(absl::StrCat("image ", line, " again"), absl::StrCat("one entry; line ", it->second, " has it"));
    LensModel lens;
    if (!Pix4dLens(k, radial, tangential, static_cast<int>(size[0]), static_cast<int>(size[1]), lens)) {
      fault("a camera matrix of another form", "f s cx / 0 f cy / 0 0 1 with f above 0");
      continue;
    }
    if (!MakeRotation(&rotation)) {
      fault("a matrix that is no rotation", "a rotation from the world to the camera");
      continue;
    }
    BlockImage& image = block->images.emplace_back();
    image.path = line;
    image.location = absl::StrCat("line ", first_line);
    image.camera = cameras.IndexOf(lens, absl::StrCat("camera of ", line));
    image.rotation_cam_from_block = rotation;
    image.centre << position[0], position[1], position[2];
  }
  if (block->images.empty() && faults->empty()) faults->Add(InputError(name, "", "no images", "entries of images"));
}

void ParsePix4dPositions(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults) {
  std::map<std::string, const BlockImage*> images;
  for (const BlockImage& image : block->images) images.emplace(image.path, &image);
  const std::string spaced = absl::StrReplaceAll(text, {{",", " "}});
  ColmapLineReader lines(spaced, name);
  std::vector<Eigen::Vector3d> offsets;
  while (lines.NextEntry()) {
    if (lines.number() == 1 && spaced.find("imageName") < 4) continue;  // the header
    // Names may contain blanks: the image is the one whose name begins the line.
    const std::string line = lines.Rest();
    const BlockImage* image = nullptr;
    size_t length = line.find_first_of(" \t");
    for (; length != std::string::npos && image == nullptr; length = line.find_first_of(" \t", length + 1)) {
      const auto it = images.find(line.substr(0, length));
      if (it == images.end()) continue;
      image = it->second;
      break;
    }
    if (image == nullptr) continue;  // images that were not calibrated
    std::string_view rest = std::string_view(line).substr(length);
    SkipBlanks(rest);
    Eigen::Vector3d position;
    bool good = true;
    for (int k = 0; k < 3; ++k) good = good && ParseNumber(TakeWord(rest), position[k]);
    if (!good || !position.allFinite()) {
      faults->Add(lines.Location().Error(Quoted(line), "an image's name, X, Y and Z"));
      continue;
    }
    offsets.push_back(position - image->centre);
  }
  if (!faults->empty()) return;
  if (offsets.empty()) {
    faults->Add(InputError(name, "", "no image of the camera parameters", "the positions of the same images"));
    return;
  }
  // Both files are rounded: the offset is the median, an integer where it is one up to the rounding.
  double spread = 0;
  for (int k = 0; k < 3; ++k) {
    const auto less = [k](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a[k] < b[k]; };
    std::sort(offsets.begin(), offsets.end(), less);
    spread = std::max(spread, offsets.back()[k] - offsets.front()[k]);
    const double median = offsets[offsets.size() / 2][k];
    block->offset[k] = std::abs(median - std::round(median)) < 1e-5 ? std::round(median) : median;
  }
  if (!(spread <= kMaxOffsetSpread)) {
    faults->Add(InputError(name, "", absl::StrCat("offsets to the camera parameters that differ by ", spread),
                           "one offset of all images, from the same adjustment"));
  }
}

void ComparePix4dMatrices(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults) {
  std::map<std::string, const BlockImage*> images;
  for (const BlockImage& image : block->images) images.emplace(image.path, &image);
  ColmapLineReader lines(text, name);
  std::vector<double> differences_px;
  while (lines.NextEntry()) {
    std::string line = lines.Rest();
    Eigen::Matrix<double, 3, 4> matrix;
    bool good = true;
    for (int k = 12; k-- > 0 && good;) {
      while (!line.empty() && IsBlank(line.back())) line.pop_back();
      const size_t blank = line.find_last_of(" \t");
      good = blank != std::string::npos && ParseNumber(line.substr(blank + 1), matrix(k / 4, k % 4));
      if (good) line.resize(blank);
    }
    while (!line.empty() && IsBlank(line.back())) line.pop_back();
    if (!good || !matrix.allFinite()) {
      faults->Add(lines.Location().Error(Quoted(line), "an image's name and 12 numbers of its matrix"));
      continue;
    }
    const auto it = images.find(line);
    if (it == images.end()) continue;
    const BlockImage& image = *it->second;
    const LensModel& lens = block->cameras[image.camera].lens;
    const PinholeCamera& p = lens.pinhole;
    // Where the matrix has points that the camera has in the corners and the middle, 100 units away.
    double worst = 0;
    for (const double x : {0.0, 0.5, 1.0}) {
      for (const double y : {0.0, 0.5, 1.0}) {
        const Eigen::Vector2d pixel(x * p.width, y * p.height);
        const double v = (pixel.y() - p.cy) / p.fy;
        const double u =
            (pixel.x() - p.cx - (lens.kind == LensModel::Kind::kBrown ? lens.coefficients[6] : 0) * v) / p.fx;
        const Eigen::Vector3d point =
            image.centre + image.rotation_cam_from_block.transpose() * Eigen::Vector3d(100 * u, 100 * v, 100);
        const Eigen::Vector3d h = matrix * point.homogeneous();
        const double difference_px = h.z() > 0 ? (h.hnormalized() - pixel).norm() : HUGE_VAL;
        worst = difference_px <= worst ? worst : difference_px;  // also NaN
      }
    }
    if (!(worst <= kMaxMatrixDifference_px)) {
      faults->Add(lines.Location().Error(
          absl::StrCat("a matrix of ", line, " that is off by ", worst, " px"),
          absl::StrCat("that of the camera parameters, up to ", kMaxMatrixDifference_px, " px")));
    }
    differences_px.push_back(worst);
  }
  if (!faults->empty() || differences_px.empty()) return;
  std::sort(differences_px.begin(), differences_px.end());
  block->conventions.push_back(
      absl::StrCat("Pix4D: K [R | -R t] agrees with the matrices of ", fs::path(name).filename().string(), " within ",
                   differences_px[differences_px.size() / 2], " px (median of ", differences_px.size(),
                   " images), at most ", differences_px.back(), " px."));
}

bool IsPix4d(const std::string& path) { return !Pix4dCameraFiles(path).empty(); }

ImportedBlock ReadPix4d(const std::string& path, const BlockReadOptions&, Faults* faults, Warnings* warnings) {
  ImportedBlock block;
  const std::vector<std::string> found = Pix4dCameraFiles(path);
  if (found.size() != 1) {
    faults->Add(InputError(path, "",
                           found.empty() ? "no camera parameters of Pix4D"
                                         : absl::StrCat(found.size(), " projects: ", absl::StrJoin(found, ", ")),
                           "one file calibrated_camera_parameters.txt"));
    return block;
  }
  const std::string cameras = AbsolutePath(found[0]), folder = fs::path(cameras).parent_path().string();
  std::string prefix = fs::path(cameras).filename().string();
  constexpr std::string_view kSuffix = "calibrated_camera_parameters.txt";
  prefix = prefix.ends_with(kSuffix) ? prefix.substr(0, prefix.size() - kSuffix.size()) : "";
  const auto read = [&](const std::string& file, std::string* text) {
    StatusOr<std::string> content = ReadFile(file, kMaxPix4dFile_bytes);
    if (!content.ok()) {
      faults->Add(content.status());
      return false;
    }
    block.files.push_back(file);
    *text = *std::move(content);
    return true;
  };
  std::string text;
  if (!read(cameras, &text)) return block;
  ParsePix4dCameras(text, cameras, &block, faults);
  block.adjusted_in_grid = true;
  block.conventions = {"Pix4D: m = K [R | -R t] X, R from the world to the camera, t the camera's centre, y down.",
                       "Pix4D: radial distortion of r^2, r^4, r^6, tangential T1, T2 as OpenCV's p1, p2.",
                       "Pix4D: the map projection is taken as Cartesian, as Pix4D adjusts in it."};
  if (!faults->empty()) return block;  // what follows refers to the images
  const auto companion = [&](const char* suffix) { return Pix4dCompanion(folder, prefix, suffix, warnings); };

  if (const std::string file = companion("offset.xyz"); !file.empty()) {
    if (read(file, &text)) ReadPix4dOffset(text, file, &block, faults);
    block.conventions.push_back("Pix4D: the offset of offset.xyz is added to positions.");
  } else if (const std::string positions = companion("calibrated_external_camera_parameters.txt"); !positions.empty()) {
    if (read(positions, &text)) ParsePix4dPositions(text, positions, &block, faults);
    block.conventions.push_back(
        "Pix4D: the offset is that of calibrated_external_camera_parameters.txt to the camera parameters.");
  }
  const bool has_offset = block.files.size() > 1;
  if (const std::string file = companion("wkt.prj"); !file.empty()) {
    if (!has_offset) {
      warnings->push_back(absl::StrCat(
          file,
          ": not applied, because Pix4D shifts coordinates and neither offset.xyz nor "
          "calibrated_external_camera_parameters.txt is beside the camera parameters; copy one of them there"));
    } else if (read(file, &text)) {
      ReadPix4dSystem(text, file, &block);
    }
  }
  if (const std::string file = companion("pmatrix.txt"); !file.empty() && read(file, &text)) {
    ComparePix4dMatrices(text, file, &block, faults);
  }
  if (const std::string file = companion("tp_pix4d.txt"); !file.empty()) {
    if (read(file, &text)) ParsePix4dTiePoints(text, file, &block, faults);
  } else {
    block.left_out.push_back(
        "tie points: Pix4D exports them as tp_pix4d.txt, which is not beside the camera parameters");
  }
  return block;
}

}  // namespace tessera
