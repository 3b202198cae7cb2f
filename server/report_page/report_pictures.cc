#include "server/report_page/report_pictures.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/geometry/mesh.h"
#include "common/imaging/jpeg_file.h"
#include "common/meshio/mesh_format.h"
#include "common/render/coloring.h"
#include "common/render/framing.h"
#include "common/storage/mapped_file.h"
#include "server/report_page/mesh_canvas.h"
#include "server/report_page/result_mesh.h"
#include "server/report_page/svg_plots.h"

namespace tessera {
namespace {

using Eigen::Vector3d, Eigen::Vector3f;

constexpr int kPictureWidth = 760, kLeastHeight = 360, kMostHeight = 560;  // of a picture, pixels
constexpr int kDirections = 8;
constexpr double kAzimuthRad = 25 * std::numbers::pi / 180, kPitchRad = 42 * std::numbers::pi / 180;
constexpr int kJpegQuality = 82;
constexpr size_t kFramingVertices = 100000;
constexpr size_t kFacesPerCheck = 1 << 16;  // between checks of the control
constexpr size_t kBins = 40;
const Vector3f kPlaster(0.90f, 0.885f, 0.86f), kNoClass(1.0f, 0.85f, 0.9f);

// The start mesh on disk, in the frame of the file.
class StartMesh : public MeshSink {
 public:
  static StatusOr<StartMesh> Read(const PictureInputs& inputs, const TaskControl& control) {
    StartMesh mesh(control);
    TESSERA_ASSIGN_OR_RETURN(mesh.vertex_list_, NewList<Vector3d>(inputs));
    TESSERA_ASSIGN_OR_RETURN(mesh.face_list_, NewList<Triangle>(inputs));
    TESSERA_ASSIGN_OR_RETURN(mesh.label_list_, NewList<int32_t>(inputs));
    MeshReadOptions options;
    options.label_property = inputs.start_label_property;
    TESSERA_RETURN_IF_ERROR(StreamMesh(inputs.start_path, options, &mesh));
    TESSERA_ASSIGN_OR_RETURN(mesh.vertices, mesh.vertex_list_->Finish());
    TESSERA_ASSIGN_OR_RETURN(mesh.faces, mesh.face_list_->Finish());
    TESSERA_ASSIGN_OR_RETURN(mesh.labels_, mesh.label_list_->Finish());
    return mesh;
  }

  ScratchArray<Vector3d> vertices;
  ScratchArray<Triangle> faces;

  bool has_labels() const { return of_ != MeshLabels::kNone; }
  int32_t Label(size_t face) const {
    if (of_ == MeshLabels::kNone) return -1;
    if (of_ == MeshLabels::kOfFaces) return labels_[face];
    const Triangle& f = faces[face];  // as LabelFacesByVertices
    return labels_[f[1]] == labels_[f[2]] ? labels_[f[1]] : labels_[f[0]];
  }

  Status Begin(const MeshLayout& layout) override {
    of_ = layout.labels;
    return control_.Check();
  }
  void AddVertex(const Vector3d& position, int32_t label) override {
    vertex_list_->Append(position);
    if (of_ == MeshLabels::kOfVertices) label_list_->Append(label);
  }
  void AddFace(const Triangle& corners, int32_t label) override {
    face_list_->Append(corners);
    if (of_ == MeshLabels::kOfFaces) label_list_->Append(label);
  }

 private:
  explicit StartMesh(const TaskControl& control) : control_(control) {}
  template <class T>
  static StatusOr<std::optional<ScratchList<T>>> NewList(const PictureInputs& inputs) {
    TESSERA_ASSIGN_OR_RETURN(auto list, ScratchList<T>::Create(inputs.scratch_folder));
    return std::optional<ScratchList<T>>(std::move(list));
  }

  const TaskControl& control_;
  MeshLabels of_ = MeshLabels::kNone;
  std::optional<ScratchList<Vector3d>> vertex_list_;
  std::optional<ScratchList<Triangle>> face_list_;
  std::optional<ScratchList<int32_t>> label_list_;
  ScratchArray<int32_t> labels_;  // of the faces or of the vertices
};

// A sample of the vertices, each as a face without area, without the few that lie far from the others.
TriangleMesh FramedVertices(const ResultMesh& mesh, const Frame& frame) {
  std::vector<Vector3d> sample;
  const size_t step = std::max<size_t>(1, mesh.vertices() / kFramingVertices);
  for (size_t v = 0; v < mesh.vertices(); v += step) {
    const Vector3d p = frame.LocalFromScene(mesh.Vertex(v));
    if (p.allFinite()) sample.push_back(p);
  }
  Eigen::AlignedBox3d box;
  if (!sample.empty()) {
    Vector3d low, high;
    std::vector<double> values(sample.size());
    for (int axis = 0; axis < 3; ++axis) {
      for (size_t i = 0; i < sample.size(); ++i) values[i] = sample[i][axis];
      std::sort(values.begin(), values.end());
      const size_t cut = std::min(1 + values.size() / 500, (values.size() - 1) / 2);
      low[axis] = values[cut];
      high[axis] = values[values.size() - 1 - cut];
    }
    const double margin_m = 0.1 * (high - low).norm();
    box = Eigen::AlignedBox3d(low - Vector3d::Constant(margin_m), high + Vector3d::Constant(margin_m));
  }
  TriangleMesh framed;
  for (const Vector3d& p : sample) {
    if (!box.contains(p)) continue;
    const auto v = static_cast<uint32_t>(framed.vertices.size());
    framed.vertices.push_back(p);
    framed.faces.push_back({v, v, v});
  }
  return framed;
}

// The oblique camera, of eight around the mesh, that shows it largest. Its picture is as high as the mesh needs.
PosedCamera PictureCamera(const TriangleMesh& framed, const Vector3d& up) {
  Eigen::AlignedBox3d box;
  for (const Vector3d& p : framed.vertices) box.extend(p);
  PosedCamera best;
  double best_m = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kDirections; ++k) {
    const double azimuth_rad = kAzimuthRad + 2 * std::numbers::pi * k / kDirections;
    const auto camera_of = [&](int height) {
      return ObliqueCamera(framed, up, azimuth_rad, kPitchRad, kPictureWidth, height);
    };
    PosedCamera camera = camera_of(kMostHeight);
    Eigen::AlignedBox2d seen;
    for (const Vector3d& p : framed.vertices) seen.extend(camera.Project(p).head<2>());
    const double height = kPictureWidth * seen.sizes().y() / std::max(seen.sizes().x(), 1.0);
    camera = camera_of(static_cast<int>(std::clamp(height, 1.0 * kLeastHeight, 1.0 * kMostHeight)));
    const double distance_m = (camera.Centre() - box.center()).norm();
    if (k == 0 || distance_m < 0.98 * best_m) {  // else the earlier direction
      best = camera;
      best_m = distance_m;
    }
  }
  return best;
}

class AreaHistogram {
 public:
  AreaHistogram(double low, double high) : low_(low), high_(high), areas_(kBins) {}
  void Add(double value, double area) {
    const double bin = (value - low_) / (high_ - low_) * kBins;
    areas_[static_cast<size_t>(std::clamp(std::isfinite(bin) ? bin : 0.0, 0.0, kBins - 1.0))] += area;
    total_ += area;
  }
  std::optional<Distribution> Shares() const {
    if (!(total_ > 0)) return std::nullopt;
    Distribution shares = {low_, high_, areas_};
    for (double& share : shares.shares) share /= total_;
    return shares;
  }

 private:
  double low_, high_;
  std::vector<double> areas_;
  double total_ = 0;
};

// Distance of `point` from the plane of a start face, positive outwards. `normal`: of the result's face at the point,
// which tells the outside, because start meshes may have turned faces.
double AlongNormal(const StartMesh& start, const Frame& frame, int64_t face, const Vector3d& point,
                   const Vector3d& normal) {
  if (face < 0 || face >= static_cast<int64_t>(start.faces.size())) return std::numeric_limits<double>::quiet_NaN();
  std::array<Vector3d, 3> p;
  for (int k = 0; k < 3; ++k) p[k] = frame.LocalFromScene(start.vertices[start.faces[static_cast<size_t>(face)][k]]);
  const Vector3d of_start = (p[1] - p[0]).cross(p[2] - p[0]).stableNormalized();
  if (!(of_start.squaredNorm() > 0.5)) return std::numeric_limits<double>::quiet_NaN();
  return of_start.dot(point - p[0]) * (of_start.dot(normal) < 0 ? -1 : 1);
}

Vector3f ClassShade(const std::vector<ReportClass>& classes, int32_t label) {
  if (label < 0 || label >= static_cast<int32_t>(classes.size())) return kNoClass;
  const auto& color = classes[static_cast<size_t>(label)].color_rgb;
  return color ? Vector3f(Vector3f((*color)[0], (*color)[1], (*color)[2]) / 255.0f) : kNoClass;
}

StatusOr<std::string> Jpeg(const MeshCanvas& canvas, const std::function<Vector3f(const FaceLook&)>& color) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, EncodeJpeg(canvas.Picture(color), kJpegQuality));
  return std::string(bytes.begin(), bytes.end());
}

struct Seen {
  bool labels = false, displacements = false, confidence = false;
};

// Draws the result and adds up its figures.
StatusOr<Seen> DrawResult(const PictureInputs& inputs, const ResultMesh& mesh, const StartMesh* start,
                          const TaskControl& control, MeshCanvas* canvas, ReportPictures* out) {
  Seen seen;
  const double range_m = out->displacement_range_m;
  AreaHistogram confidence(0, 1), displacement(-2 * range_m, 2 * range_m);
  double confidence_area_m2 = 0, confidence_sum = 0, unseen_m2 = 0;
  for (size_t f = 0; f < mesh.faces(); ++f) {
    if (f % kFacesPerCheck == 0) TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const ResultFace face, mesh.Face(f));
    std::array<Vector3d, 3> p;
    for (int k = 0; k < 3; ++k) p[k] = inputs.frame.LocalFromScene(mesh.Vertex(face.corners[k]));
    const Vector3d cross = (p[1] - p[0]).cross(p[2] - p[0]);
    const double area_m2 = 0.5 * cross.norm();
    if (!std::isfinite(area_m2)) continue;
    out->area_m2 += area_m2;
    out->plan_area_m2 += std::max(0.0, 0.5 * cross.dot(inputs.up));
    FaceLook look;
    look.label = face.label;
    seen.labels = seen.labels || face.label >= 0;
    if (face.color_rgb && face.label >= 0 && face.label < static_cast<int32_t>(out->classes.size())) {
      out->classes[static_cast<size_t>(face.label)].color_rgb = face.color_rgb;
    }
    look.displacement_m = std::numeric_limits<float>::quiet_NaN();
    if (start != nullptr && face.input_face && range_m > 0) {
      const double along_m =
          AlongNormal(*start, inputs.frame, *face.input_face, (p[0] + p[1] + p[2]) / 3, cross.stableNormalized());
      look.displacement_m = static_cast<float>(along_m);
      if (std::isfinite(along_m)) {
        seen.displacements = true;
        displacement.Add(along_m, area_m2);
      }
    }
    if (face.confidence && std::isfinite(*face.confidence)) {
      look.confidence = *face.confidence;
      confidence_area_m2 += area_m2;
      if (look.confidence > 0) {
        seen.confidence = true;
        confidence.Add(look.confidence, area_m2);
        confidence_sum += look.confidence * area_m2;
      } else {
        unseen_m2 += area_m2;
      }
    }
    canvas->Draw(p[0], p[1], p[2], look);
  }
  if (seen.confidence) {
    out->confidence_shares = confidence.Shares();
    out->mean_confidence = confidence_sum / std::max(confidence_area_m2 - unseen_m2, 1e-30);
    out->unseen_share = unseen_m2 / confidence_area_m2;
  }
  if (seen.displacements) out->displacement_shares = displacement.Shares();
  return seen;
}

Status DrawStart(const PictureInputs& inputs, const StartMesh& mesh, const TaskControl& control, MeshCanvas* canvas) {
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (f % kFacesPerCheck == 0) TESSERA_RETURN_IF_ERROR(control.Check());
    std::array<Vector3d, 3> p;
    for (int k = 0; k < 3; ++k) p[k] = inputs.frame.LocalFromScene(mesh.vertices[mesh.faces[f][k]]);
    canvas->Draw(p[0], p[1], p[2], {.label = mesh.Label(f), .confidence = 0, .displacement_m = 0});
  }
  canvas->Light();
  return absl::OkStatus();
}

// The start mesh, or why it cannot be shown. CANCELLED by `control`.
StatusOr<std::optional<StartMesh>> TryStart(const PictureInputs& inputs, const TaskControl& control,
                                            std::string* no_start) {
  if (inputs.start_path.empty()) return std::nullopt;
  StatusOr<StartMesh> start = StartMesh::Read(inputs, control);
  TESSERA_RETURN_IF_ERROR(control.Check());
  if (!start.ok()) {
    *no_start = absl::StrCat("The start mesh cannot be read: ", std::string(start.status().message()));
    return std::nullopt;
  }
  if (static_cast<int64_t>(start->faces.size()) != inputs.start_faces) {
    *no_start = absl::StrCat("The scene's mesh has changed since the job: it has ", start->faces.size(),
                             " faces, and had ", inputs.start_faces, ".");
    return std::nullopt;
  }
  return std::optional<StartMesh>(std::move(*start));
}

}  // namespace

Vector3f DisplacementShade(float value) { return DivergingColor(value); }

// Dark purple to green to yellow (the ends and the middle of viridis).
Vector3f ConfidenceShade(float value) {
  const Vector3f low(0.36f, 0.16f, 0.48f), middle(0.13f, 0.57f, 0.55f), high(0.99f, 0.91f, 0.30f);
  const float v = std::clamp(value, 0.0f, 1.0f);
  return v < 0.5f ? Vector3f(low + 2 * v * (middle - low)) : Vector3f(middle + (2 * v - 1) * (high - middle));
}

StatusOr<ReportPictures> DrawReportPictures(const PictureInputs& inputs, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ResultMesh mesh, ResultMesh::Open(inputs.mesh_path));
  ReportPictures out;
  out.classes = inputs.classes;
  if (inputs.typical_displacement_m > 0) out.displacement_range_m = NiceCeiling(inputs.typical_displacement_m);
  const TriangleMesh framed = FramedVertices(mesh, inputs.frame);
  if (framed.faces.empty()) return InputError(inputs.mesh_path, "", "no vertices", "the mesh of a result");
  const PosedCamera camera = PictureCamera(framed, inputs.up);
  Eigen::AlignedBox3d box;
  for (const Vector3d& p : framed.vertices) box.extend(p);
  const double occlusion_range_m = std::max(0.05 * box.diagonal().norm(), 1e-9);
  out.width_px = camera.intrinsics.width;
  out.height_px = camera.intrinsics.height;

  TESSERA_ASSIGN_OR_RETURN(const std::optional<StartMesh> start, TryStart(inputs, control, &out.no_start));
  MeshCanvas result(camera, inputs.up, occlusion_range_m);
  TESSERA_ASSIGN_OR_RETURN(const Seen seen,
                           DrawResult(inputs, mesh, start ? &*start : nullptr, control, &result, &out));
  result.Light();
  const auto plaster = [](const FaceLook&) { return kPlaster; };
  const auto by_class = [&](const FaceLook& look) { return ClassShade(out.classes, look.label); };
  TESSERA_ASSIGN_OR_RETURN(out.shaded, Jpeg(result, plaster));
  if (seen.labels) {
    TESSERA_ASSIGN_OR_RETURN(out.labels, Jpeg(result, by_class));
  }
  if (seen.displacements) {
    const auto range_m = static_cast<float>(out.displacement_range_m);
    TESSERA_ASSIGN_OR_RETURN(
        out.displacement, Jpeg(result, [&](const FaceLook& look) -> Vector3f {
          return std::isfinite(look.displacement_m) ? DisplacementShade(look.displacement_m / range_m) : kNoClass;
        }));
  }
  if (seen.confidence) {
    TESSERA_ASSIGN_OR_RETURN(out.confidence, Jpeg(result, [](const FaceLook& look) -> Vector3f {
                               return look.confidence > 0 ? ConfidenceShade(look.confidence)
                                                          : Vector3f(0.6f, 0.6f, 0.6f);
                             }));
  }
  if (!start) return out;
  MeshCanvas before(camera, inputs.up, occlusion_range_m);
  TESSERA_RETURN_IF_ERROR(DrawStart(inputs, *start, control, &before));
  TESSERA_ASSIGN_OR_RETURN(out.start_shaded, Jpeg(before, plaster));
  if (start->has_labels()) {
    TESSERA_ASSIGN_OR_RETURN(out.start_labels, Jpeg(before, by_class));
  }
  return out;
}

}  // namespace tessera
