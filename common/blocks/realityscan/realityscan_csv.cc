// Tables of camera parameters; realityscan.cc has their conventions.
#include <algorithm>
#include <cmath>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/blocks/block_parts.h"
#include "common/blocks/realityscan/realityscan.h"
#include "common/colmap/colmap_lines.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kMaxCsvFaults = 200;

constexpr double kCsvRadians = 3.14159265358979323846 / 180;

// World to camera. World from camera (x right, y up, z back) is Rz(-yaw) Rx(pitch) Ry(roll).
Eigen::Matrix3d CsvRotation(double yaw_deg, double pitch_deg, double roll_deg) {
  const double cy = std::cos(yaw_deg * kCsvRadians), sy = std::sin(yaw_deg * kCsvRadians);
  const double cp = std::cos(pitch_deg * kCsvRadians), sp = std::sin(pitch_deg * kCsvRadians);
  const double cr = std::cos(roll_deg * kCsvRadians), sr = std::sin(roll_deg * kCsvRadians);
  Eigen::Matrix3d rotation;
  rotation << cr * cy + sr * sp * sy, -cr * sy + cy * sr * sp, -cp * sr,  //
      -cp * sy, -cp * cy, -sp,                                            //
      cr * sp * sy - cy * sr, cr * cy * sp + sr * sy, -cr * cp;
  return rotation;
}

// Columns of the table, by the names that RealityScan's templates give them.
struct CsvColumn {
  const char* names[2];
  bool is_required;
  int index = -1;  // in a line; -1: not there
};
enum CsvField {
  kCsvName,
  kCsvX,
  kCsvY,
  kCsvAlt,
  kCsvYaw,
  kCsvPitch,
  kCsvRoll,
  kCsvFocal,
  kCsvPx,
  kCsvPy,
  kCsvK1,
  kCsvK2,
  kCsvK3,
  kCsvK4,
  kCsvT1,
  kCsvT2,
  kCsvFields
};
using CsvColumns = std::array<CsvColumn, kCsvFields>;

CsvColumns NoCsvColumns() {
  return {{{{"name", ""}, true},
           {{"x", ""}, true},
           {{"y", ""}, true},
           {{"alt", ""}, true},
           {{"heading", "yaw"}, true},
           {{"pitch", ""}, true},
           {{"roll", ""}, true},
           {{"f", "f_35mm"}, true},
           {{"px", "px_norm"}, false},
           {{"py", "py_norm"}, false},
           {{"k1", ""}, false},
           {{"k2", ""}, false},
           {{"k3", ""}, false},
           {{"k4", ""}, false},
           {{"t1", ""}, false},
           {{"t2", ""}, false}}};
}

std::vector<std::string> CsvWords(const std::string& line) {
  std::vector<std::string> words = absl::StrSplit(line, ',');
  for (std::string& word : words) word = std::string(absl::StripAsciiWhitespace(word));
  return words;
}

// Finds the columns in the header, which begins with #. False if required ones are missing; `twice`: a column that is
// there twice; `others`: columns without meaning here.
bool FindCsvColumns(const std::string& header, CsvColumns& columns, std::string* twice,
                    std::vector<std::string>* others) {
  columns = NoCsvColumns();
  const std::vector<std::string> words = CsvWords(header);
  for (size_t i = 0; i < words.size(); ++i) {
    std::string word = absl::AsciiStrToLower(words[i]);
    if (i == 0 && word.starts_with("#")) word = std::string(absl::StripAsciiWhitespace(word.substr(1)));
    const auto column = std::find_if(columns.begin(), columns.end(), [&](const CsvColumn& c) {
      return !word.empty() && (word == c.names[0] || word == c.names[1]);
    });
    if (column == columns.end()) {
      if (others != nullptr) others->push_back(words[i]);
      continue;
    }
    if (column->index >= 0 && twice != nullptr) *twice = words[i];
    column->index = static_cast<int>(i);
  }
  return std::all_of(columns.begin(), columns.end(), [](const CsvColumn& c) { return c.index >= 0 || !c.is_required; });
}

}  // namespace

bool IsRealityScanCsv(const std::string& path) {
  const StatusOr<std::string> start = ReadFileRange(path, 0, 1024);
  if (!start.ok()) return false;
  ColmapLineReader lines(*start, path);
  CsvColumns columns;
  for (int i = 0; i < 2 && lines.Next(); ++i) {
    if (FindCsvColumns(lines.Rest(), columns, nullptr, nullptr)) return true;
  }
  return false;
}

void ParseRealityScanCsv(const std::string& text, const std::string& name, const PhotographSize& size_of,
                         ImportedBlock* block, Faults* faults) {
  ColmapLineReader lines(text, name);
  CsvColumns columns;
  std::string twice;
  std::vector<std::string> others;
  int64_t stated_images = -1;
  bool has_header = false;
  while (!has_header && lines.Next()) {
    const std::string line = lines.Rest();
    if (line.starts_with("#cameras ")) {  // of older templates
      if (!ParseInteger(line.substr(9), stated_images)) {
        faults->Add(lines.Location().Error(Quoted(line), "#cameras and their number"));
      }
      continue;
    }
    if (line.empty()) continue;
    others.clear();
    has_header = FindCsvColumns(line, columns, &twice, &others);
    if (has_header) break;
    faults->Add(
        lines.Location().Error(Quoted(line),
                               "a header with name, x, y, alt, heading or yaw, pitch, roll, f or f_35mm; export "
                               "'Internal/External camera parameters'"));
    return;
  }
  if (!has_header) return faults->Add(lines.Location().Error("the end of the file", "a header"));
  if (!twice.empty()) return faults->Add(lines.Location().Error(absl::StrCat("column ", twice, " again"), "one"));
  if (!others.empty()) block->left_out.push_back(absl::StrCat("columns ", absl::StrJoin(others, ", ")));
  size_t fewest_words = 0;
  for (const CsvColumn& column : columns) fewest_words = std::max(fewest_words, static_cast<size_t>(column.index + 1));
  size_t header_words = others.size();
  for (const CsvColumn& column : columns) header_words += column.index >= 0;

  SharedCameras cameras(block);
  std::map<std::string, int64_t> lines_of_names;
  int64_t images = 0;
  while (lines.NextContent() && faults->messages().size() < kMaxCsvFaults) {
    const std::string line = lines.Rest();
    if (line.empty()) continue;
    const std::vector<std::string> words = CsvWords(line);
    ++images;
    if (words.size() != header_words) {
      faults->Add(lines.Location().Error(absl::StrCat(words.size(), " columns"),
                                         absl::StrCat(header_words, " columns, as in the header")));
      continue;
    }
    std::array<double, kCsvFields> values = {};
    bool good = true;
    for (int field = kCsvX; field < kCsvFields; ++field) {
      if (columns[field].index < 0) continue;
      const std::string& word = words[columns[field].index];
      if (ParseNumber(word, values[field]) && std::abs(values[field]) <= kMaxRealityScanNumber) continue;
      faults->Add(lines.Location().Error(Quoted(word), absl::StrCat("a number in column ", columns[field].names[0])));
      good = false;
    }
    const std::string& image_name = words[columns[kCsvName].index];
    if (good && !(values[kCsvFocal] > 0)) {
      faults->Add(lines.Location().Error(absl::StrCat("focal length ", values[kCsvFocal]), "one above 0"));
      good = false;
    }
    const auto [it, is_new] = lines_of_names.emplace(image_name, lines.number());
    if (image_name.empty() || !is_new) {
      faults->Add(lines.Location().Error(
          image_name.empty() ? "no name" : absl::StrCat("image ", image_name, " again"),
          image_name.empty() ? "the name of an image" : absl::StrCat("one line; line ", it->second, " has it")));
      good = false;
    }
    if (!good) continue;
    const StatusOr<ImageSize> size = size_of(image_name);
    if (!size.ok()) {
      faults->Add(ImageSizeFault(name, absl::StrCat("line ", lines.number()), image_name, size.status(), block));
      continue;
    }
    RealityScanCamera camera;
    camera.focal_35mm = values[kCsvFocal];
    camera.principal_u = values[kCsvPx];
    camera.principal_v = values[kCsvPy];
    for (int k = 0; k < 6; ++k) camera.distortion[k] = values[kCsvK1 + k];
    BlockImage& image = block->images.emplace_back();
    image.path = image_name;
    image.location = absl::StrCat("line ", lines.number());
    image.rotation_cam_from_block = CsvRotation(values[kCsvYaw], values[kCsvPitch], values[kCsvRoll]);
    image.centre << values[kCsvX], values[kCsvY], values[kCsvAlt];
    image.camera = cameras.IndexOf(RealityScanLens(camera, *size), absl::StrCat("camera of ", image_name));
  }
  if (stated_images >= 0 && stated_images != images) {
    faults->Add(
        InputError(name, "", absl::StrCat(images, " images"), absl::StrCat(stated_images, ", as #cameras says")));
  }
  if (images == 0) faults->Add(InputError(name, "", "no images", "a line for each image"));
  block->conventions.push_back(
      "RealityScan CSV: heading clockwise from the y axis, pitch 0 looks down and 90 to the horizon, then roll.");
  block->conventions.push_back(
      "RealityScan CSV: the table does not name the lens model; its coefficients are taken as Brown's, not "
      "division's.");
}

}  // namespace tessera
