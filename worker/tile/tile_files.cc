#include "worker/tile/tile_files.h"

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/arrays/array_file.h"
#include "common/job/survey.h"

namespace tessera {
namespace {

using nlohmann::json;

json VectorToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Eigen::Vector3d VectorFromJson(const json& j) {
  return Eigen::Vector3d(j.at(0).get<double>(), j.at(1).get<double>(), j.at(2).get<double>());
}

// Runs `read` on a file's metadata and turns JSON errors into DATA_LOSS.
template <class Read>
Status ReadMetadata(const std::string& metadata, const std::string& file, const Read& read) {
  try {
    read(json::parse(metadata));
    return absl::OkStatus();
  } catch (const json::exception& e) {
    return absl::DataLossError(file + ": metadata: " + e.what());
  }
}

// Records that consist of numbers of one type, as an array of these.
template <class Number, class Record>
std::vector<Number> ToNumbers(const std::vector<Record>& records) {
  static_assert(sizeof(Record) % sizeof(Number) == 0 && alignof(Record) == alignof(Number));
  const auto* first = reinterpret_cast<const Number*>(records.data());
  return {first, first + records.size() * sizeof(Record) / sizeof(Number)};
}

// A view of an array as records of numbers of one type; a partial record at the end is ignored.
template <class Record, class Number>
std::span<const Record> ToRecords(std::span<const Number> numbers) {
  static_assert(sizeof(Record) % sizeof(Number) == 0 && alignof(Record) == alignof(Number));
  return {reinterpret_cast<const Record*>(numbers.data()), numbers.size_bytes() / sizeof(Record)};
}

// The arrays of a file that is written from where its values are, without copies.
class SpansFile {
 public:
  template <class Number, class Record>
  void Put(std::string name, const std::vector<Record>& records) {
    static_assert(sizeof(Record) % sizeof(Number) == 0 && alignof(Record) == alignof(Number));
    const std::span<const Number> values(reinterpret_cast<const Number*>(records.data()),
                                         records.size() * sizeof(Record) / sizeof(Number));
    arrays_.push_back({name, std::vector<Number>(), values.size()});
    appends_.push_back([name = std::move(name), values](ArrayFileWriter* file) { file->Append(name, values); });
  }

  // The vectors must still be as they were. Errors as ArrayFileWriter.
  Status Write(const std::string& path, const std::string& metadata) const {
    TESSERA_ASSIGN_OR_RETURN(const auto file, ArrayFileWriter::Create(path, metadata, arrays_));
    for (const auto& append : appends_) append(file.get());
    return file->Finish();
  }

 private:
  std::vector<ArrayFileWriter::Array> arrays_;
  std::vector<std::function<void(ArrayFileWriter*)>> appends_;
};

template <class T>
std::vector<T> Copy(std::span<const T> values) {
  return {values.begin(), values.end()};
}

constexpr int kContourNumbers = 3 * (3 + 6);

// Nested rows as offsets and items.
void PutRows(const std::vector<std::vector<int32_t>>& rows, const std::string& name, ArrayFile* file) {
  std::vector<uint32_t> begin = {0};
  std::vector<int32_t> items;
  for (const std::vector<int32_t>& row : rows) {
    items.insert(items.end(), row.begin(), row.end());
    begin.push_back(static_cast<uint32_t>(items.size()));
  }
  file->arrays[name + "_begin"] = std::move(begin);
  file->arrays[name] = std::move(items);
}

StatusOr<std::vector<std::vector<int32_t>>> TakeRows(const std::string& name, int64_t count, ArrayFile* file) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> begin, file->Take<uint32_t>(name + "_begin", count + 1));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<int32_t> items, file->Take<int32_t>(name));
  std::vector<std::vector<int32_t>> rows;
  for (int64_t i = 0; i < count; ++i) {
    if (begin[i] > begin[i + 1] || begin[i + 1] > items.size()) {
      return absl::DataLossError(
          absl::StrCat(file->name, ": ", name, ": row ", i, ": found offsets that do not ascend or exceed the items"));
    }
    rows.emplace_back(items.begin() + begin[i], items.begin() + begin[i + 1]);
  }
  return rows;
}

Status CheckBegins(std::span<const uint32_t> begin, size_t count, const std::string& name, const std::string& file) {
  if (begin.front() == 0 && begin.back() == count && std::is_sorted(begin.begin(), begin.end())) {
    return absl::OkStatus();
  }
  return absl::DataLossError(absl::StrCat(file, ": ", name, ": found no ascending offsets from 0 to ", count));
}

// A mesh as the arrays mesh.vertices (3 doubles each), mesh.faces (3 indices each) and mesh.labels.
void PutMesh(const TriangleMesh& mesh, ArrayFile* file) {
  file->arrays["mesh.vertices"] = ToNumbers<double>(mesh.vertices);
  file->arrays["mesh.faces"] = ToNumbers<uint32_t>(mesh.faces);
  file->arrays["mesh.labels"] = mesh.labels;
}

// DATA_LOSS if arrays are missing or inconsistent.
StatusOr<TriangleMesh> TakeMesh(ArrayFile* file) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<double> positions, file->Take<double>("mesh.vertices"));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> corners, file->Take<uint32_t>("mesh.faces"));
  TriangleMesh mesh;
  TESSERA_ASSIGN_OR_RETURN(mesh.labels, file->Take<int32_t>("mesh.labels"));
  if (positions.size() % 3 != 0)
    return absl::DataLossError(file->name + ": mesh.vertices: expected 3 values per point");
  if (corners.size() % 3 != 0) return absl::DataLossError(file->name + ": mesh.faces: expected 3 indices per face");
  mesh.vertices = Copy(ToRecords<Eigen::Vector3d>(std::span<const double>(positions)));
  mesh.faces = Copy(ToRecords<Triangle>(std::span<const uint32_t>(corners)));
  for (const uint32_t corner : corners) {
    if (corner < mesh.vertices.size()) continue;
    return absl::DataLossError(
        absl::StrCat(file->name, ": mesh.faces: found vertex ", corner, ", expected less than ", mesh.vertices.size()));
  }
  if (!mesh.labels.empty() && mesh.labels.size() != mesh.faces.size()) {
    return absl::DataLossError(
        absl::StrCat(file->name, ": mesh.labels: found ", mesh.labels.size(), ", expected ", mesh.faces.size()));
  }
  return mesh;
}

// Checks that offsets of cells ascend from 0 to `count`.
StatusOr<std::vector<uint32_t>> TakeBegins(const std::string& name, size_t cells, size_t count, ArrayFile* file) {
  TESSERA_ASSIGN_OR_RETURN(std::vector<uint32_t> begin, file->Take<uint32_t>(name, static_cast<int64_t>(cells) + 1));
  TESSERA_RETURN_IF_ERROR(CheckBegins(begin, count, name, file->name));
  return begin;
}

}  // namespace

Status WriteTilePackage(const std::string& path, const TilePackage& p) {
  ArrayFile file;
  std::vector<std::array<int, 4>> rects;
  for (const PixelRect& r : p.view_rects) rects.push_back({r.x0, r.y0, r.x1, r.y1});
  file.metadata = json{
      {"tile", p.tile},
      {"ground_axis_x", VectorToJson(p.ground.axis_x)},
      {"ground_axis_y", VectorToJson(p.ground.axis_y)},
      {"cell_m", p.ground.cell_m},
      {"gsd_m", p.gsd_m},
      {"up", VectorToJson(p.up)},
      {"has_likelihoods", p.has_likelihoods},
      {"has_labels", p.has_labels},
      {"compares", p.has_pairs},
      {"classes", json::parse(ClassesToJson(p.classes))},
      {"borders", json::parse(BordersToJson(p.borders))},
      {"views", json::parse(ViewsToJson(p.views))},
      {"view_ids", p.view_ids},
      {"view_rects", rects},
      {"view_depths", p.view_depths},
      {"pairs",
       p.pairs}}.dump();
  file.arrays["cells"] = ToNumbers<int32_t>(p.cell_at);
  PutRows(p.cell_views, "cell_views", &file);
  file.arrays["cell_faces"] = p.cells.face_begin;
  file.arrays["cell_vertices"] = p.cells.vertex_begin;
  PutMesh(p.mesh, &file);
  file.arrays["vertex_ids"] = p.vertex_ids;
  file.arrays["face_ids"] = p.face_ids;
  file.arrays["regions"] = p.regions;
  file.arrays["cut_regions"] = p.cut_regions;
  return WriteArrayFile(path, file);
}

// `metadata`: of the file at `path`.
static StatusOr<TilePackage> ParseTileViews(const std::string& metadata, const std::string& path) {
  TilePackage p;
  std::string classes, borders, views;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(metadata, path, [&](const json& j) {
    p.tile = j.at("tile");
    p.ground.axis_x = VectorFromJson(j.at("ground_axis_x"));
    p.ground.axis_y = VectorFromJson(j.at("ground_axis_y"));
    p.ground.cell_m = j.at("cell_m");
    p.gsd_m = j.at("gsd_m");
    p.up = VectorFromJson(j.at("up"));
    p.has_likelihoods = j.at("has_likelihoods");
    p.has_labels = j.at("has_labels");
    p.has_pairs = j.at("compares");
    p.pairs = j.at("pairs").get<std::vector<std::array<int32_t, 2>>>();
    p.view_ids = j.at("view_ids").get<std::vector<int32_t>>();
    for (const auto& r : j.at("view_rects").get<std::vector<std::array<int, 4>>>()) {
      p.view_rects.push_back({r[0], r[1], r[2], r[3]});
    }
    p.view_depths = j.at("view_depths").get<std::vector<std::array<double, 2>>>();
    classes = j.at("classes").dump();
    borders = j.at("borders").dump();
    views = j.at("views").dump();
  }));
  TESSERA_ASSIGN_OR_RETURN(p.classes, ParseClasses(classes));
  TESSERA_ASSIGN_OR_RETURN(p.borders, ParseBorders(borders, p.classes.size()));
  TESSERA_ASSIGN_OR_RETURN(p.views, ParseViews(views));
  if (p.view_depths.size() != p.views.size() || p.view_ids.size() != p.views.size() ||
      p.view_rects.size() != p.views.size()) {
    return absl::DataLossError(absl::StrCat(path, ": found ", p.view_depths.size(), " depths, ", p.view_ids.size(),
                                            " ids and ", p.view_rects.size(), " windows of ", p.views.size(),
                                            " views"));
  }
  return p;
}

StatusOr<TilePackage> ReadTileViews(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const MappedArrays file, MappedArrays::Open(path));
  return ParseTileViews(file.metadata(), path);
}

StatusOr<TilePackage> ReadTilePackage(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TESSERA_ASSIGN_OR_RETURN(TilePackage p, ParseTileViews(file.metadata, path));
  TESSERA_ASSIGN_OR_RETURN(p.mesh, TakeMesh(&file));
  const int64_t vertices = static_cast<int64_t>(p.mesh.vertices.size());
  const int64_t faces = static_cast<int64_t>(p.mesh.faces.size());
  TESSERA_ASSIGN_OR_RETURN(const std::vector<int32_t> cells, file.Take<int32_t>("cells"));
  p.cell_at = Copy(ToRecords<std::array<int32_t, 2>>(std::span<const int32_t>(cells)));
  TESSERA_ASSIGN_OR_RETURN(p.cell_views, TakeRows("cell_views", static_cast<int64_t>(p.cell_at.size()), &file));
  for (const std::vector<int32_t>& of_cell : p.cell_views) {
    for (const int32_t view : of_cell) {
      if (view >= 0 && static_cast<size_t>(view) < p.views.size()) continue;
      return absl::DataLossError(absl::StrCat(path, ": cell_views: found view ", view,
                                              ", expected at least 0 and less than ", p.views.size()));
    }
  }
  TESSERA_ASSIGN_OR_RETURN(p.cells.face_begin, TakeBegins("cell_faces", p.cell_at.size(), faces, &file));
  TESSERA_ASSIGN_OR_RETURN(p.cells.vertex_begin, TakeBegins("cell_vertices", p.cell_at.size(), vertices, &file));
  TESSERA_ASSIGN_OR_RETURN(p.vertex_ids, file.Take<uint32_t>("vertex_ids", vertices));
  TESSERA_ASSIGN_OR_RETURN(p.face_ids, file.Take<uint32_t>("face_ids", faces));
  TESSERA_ASSIGN_OR_RETURN(p.regions, file.Take<uint8_t>("regions", faces));
  TESSERA_ASSIGN_OR_RETURN(p.cut_regions, file.Take<uint8_t>("cut_regions", vertices));
  FindVertexCells(p.mesh.faces, &p.cells);
  return p;
}

Status WriteTileSums(const std::string& path, const TileSums& s) {
  SpansFile file;
  const std::string metadata = json{{"tile", s.tile},
                                    {"classes", s.classes},
                                    {"energy", s.energy},
                                    {"semantic_energy", s.semantic_energy},
                                    {"warped_pixels", s.warped_pixels},
                                    {"fit", s.fit}}
                                   .dump();
  const auto put = [&](const std::string& prefix, const FaceSumsById& sums) {
    file.Put<uint32_t>(prefix + "face_ids", sums.face_ids);
    file.Put<float>(prefix + "photo", sums.photo);
    file.Put<float>(prefix + "likelihoods", sums.likelihoods);
    file.Put<float>(prefix + "pixels", sums.pixels);
  };
  put("", s);
  put("sample_", s.sample);
  std::vector<uint32_t> faces, views_begin = {0};
  std::vector<double> contours;
  for (const FaceContour& c : s.contours.faces) {
    faces.push_back(c.face);
    views_begin.push_back(c.views_end);
    for (int k = 0; k < 3; ++k) {
      contours.insert(contours.end(), c.gradient[k].data(), c.gradient[k].data() + 3);
      contours.insert(contours.end(), c.curvature[k].data(), c.curvature[k].data() + 6);
    }
  }
  file.Put<uint32_t>("contour_faces", faces);
  file.Put<double>("contours", contours);
  file.Put<uint32_t>("contour_views_begin", views_begin);
  file.Put<int32_t>("contour_views", s.contours.views);
  return file.Write(path, metadata);
}

StatusOr<TileSums> ReadTileSums(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const MappedArrays file, MappedArrays::Open(path));
  TileSums s;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(file.metadata(), path, [&](const json& j) {
    s.tile = j.at("tile");
    s.classes = j.at("classes");
    s.energy = j.at("energy");
    s.semantic_energy = j.at("semantic_energy");
    s.warped_pixels = j.at("warped_pixels");
    s.fit = j.at("fit");
  }));
  const auto read = [&]<class T>(const std::string& name, std::vector<T>* out) -> Status {
    TESSERA_ASSIGN_OR_RETURN(const std::span<const T> values, file.Verified<T>(name));
    *out = Copy(values);
    return absl::OkStatus();
  };
  const auto read_faces = [&](const std::string& prefix, FaceSumsById* sums) -> Status {
    TESSERA_RETURN_IF_ERROR(read(prefix + "face_ids", &sums->face_ids));
    TESSERA_ASSIGN_OR_RETURN(const auto photo, file.Verified<float>(prefix + "photo"));
    sums->photo = Copy(ToRecords<FaceSums>(photo));
    TESSERA_RETURN_IF_ERROR(read(prefix + "likelihoods", &sums->likelihoods));
    return read(prefix + "pixels", &sums->pixels);
  };
  TESSERA_RETURN_IF_ERROR(read_faces("", &s));
  TESSERA_RETURN_IF_ERROR(read_faces("sample_", &s.sample));
  TESSERA_ASSIGN_OR_RETURN(const auto faces, file.Verified<uint32_t>("contour_faces"));
  TESSERA_ASSIGN_OR_RETURN(const auto contours,
                           file.Verified<double>("contours", kContourNumbers * static_cast<int64_t>(faces.size())));
  TESSERA_RETURN_IF_ERROR(read("contour_views", &s.contours.views));
  constexpr char kViewsBegin[] = "contour_views_begin";
  TESSERA_ASSIGN_OR_RETURN(const auto views_begin,
                           file.Verified<uint32_t>(kViewsBegin, static_cast<int64_t>(faces.size()) + 1));
  TESSERA_RETURN_IF_ERROR(CheckBegins(views_begin, s.contours.views.size(), kViewsBegin, path));
  for (size_t i = 0; i < faces.size(); ++i) {
    FaceContour c;
    c.face = faces[i];
    c.views_begin = views_begin[i];
    c.views_end = views_begin[i + 1];
    const double* at = &contours[i * kContourNumbers];
    for (int k = 0; k < 3; ++k, at += 9) {
      c.gradient[k] = Eigen::Map<const Eigen::Vector3d>(at);
      c.curvature[k] = Eigen::Map<const Eigen::Matrix<double, 6, 1>>(at + 3);
    }
    s.contours.faces.push_back(c);
  }
  const auto fit = [&](const FaceSumsById& of) {
    const size_t count = of.face_ids.size();
    return (of.photo.empty() || of.photo.size() == count) && (of.pixels.empty() || of.pixels.size() == count) &&
           of.likelihoods.size() == of.pixels.size() * static_cast<size_t>(std::max(s.classes, 0));
  };
  const size_t count = s.face_ids.size();
  const bool fits =
      fit(s) && fit(s.sample) && std::all_of(faces.begin(), faces.end(), [&](uint32_t f) { return f < count; });
  if (!fits)
    return absl::DataLossError(
        absl::StrCat(path, ": found sums of another number of faces than the ", count, " faces listed"));
  return s;
}

double MeanConfidence(const TileState& state) {
  double sum = 0;
  int64_t count = 0;
  for (const float confidence : state.confidence) {
    sum += confidence;
    count += confidence > 0;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

Status WriteTileState(const std::string& path, const TileState& s) {
  SpansFile file;
  file.Put<uint32_t>("vertex_ids", s.vertex_ids);
  file.Put<double>("positions", s.positions);
  file.Put<double>("level_start", s.level_start);
  file.Put<float>("last_step", s.last_step);
  file.Put<uint32_t>("face_ids", s.face_ids);
  file.Put<int32_t>("labels", s.labels);
  file.Put<float>("confidence", s.confidence);
  return file.Write(
      path, json{{"tile", s.tile}, {"in_level", !s.level_start.empty()}, {"report", json::parse(s.report)}}.dump());
}

StatusOr<MappedState> MappedState::Open(const std::string& path) {
  MappedState state;
  TESSERA_ASSIGN_OR_RETURN(state.file_, MappedArrays::Open(path));
  const MappedArrays& file = state.file_;
  StateSpans& s = state.spans_;
  bool in_level = false;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(file.metadata(), path, [&](const json& j) {
    s.tile = j.at("tile");
    in_level = j.at("in_level");
    s.report = j.at("report").dump();
  }));
  TESSERA_ASSIGN_OR_RETURN(s.vertex_ids, file.Verified<uint32_t>("vertex_ids"));
  const auto vertices = static_cast<int64_t>(s.vertex_ids.size());
  TESSERA_ASSIGN_OR_RETURN(const auto positions, file.Verified<double>("positions", 3 * vertices));
  s.positions = ToRecords<Eigen::Vector3d>(positions);
  TESSERA_ASSIGN_OR_RETURN(const auto level_start, file.Verified<double>("level_start", in_level ? 3 * vertices : 0));
  s.level_start = ToRecords<Eigen::Vector3d>(level_start);
  TESSERA_ASSIGN_OR_RETURN(const auto last_step, file.Verified<float>("last_step", in_level ? 3 * vertices : 0));
  s.last_step = ToRecords<Eigen::Vector3f>(last_step);
  TESSERA_ASSIGN_OR_RETURN(s.face_ids, file.Verified<uint32_t>("face_ids"));
  const auto faces = static_cast<int64_t>(s.face_ids.size());
  TESSERA_ASSIGN_OR_RETURN(s.labels, file.Verified<int32_t>("labels", faces));
  TESSERA_ASSIGN_OR_RETURN(s.confidence, file.Verified<float>("confidence", faces));
  return state;
}

}  // namespace tessera
