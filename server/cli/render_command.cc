// `tessera render`: renders a mesh to a PNG picture.
#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/parallel.h"
#include "common/base/printable.h"
#include "common/geometry/nearest_surface.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/render/annotation.h"
#include "common/render/coloring.h"
#include "common/render/framing.h"
#include "common/render/renderer.h"
#include "common/scene/scene.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

enum class Mode { kShaded, kLabels, kErrors, kDisplacement, kNormals };
const std::vector<std::string> kModeNames = {"shaded", "labels", "errors", "displacement", "normals"};  // in that order

struct RenderArguments {
  std::string mesh, out;
  std::string compare;
  std::string scene;
  std::string reference;
  std::string truth;
  std::string view = "oblique";
  std::string mode_name = kModeNames[0];
  Mode mode = Mode::kShaded;
  std::string size;
  std::vector<double> zoom;
  double azimuth_deg = 45, pitch_deg = 40;
  std::optional<double> range_m;
  std::vector<std::string> captions;
  bool edges = false, plain = false;
  int samples_per_axis = 2, occlusion_rays = 16;
  int threads = 0;
};

struct Picture {
  int width = 1600, height = 1200;
  bool given = false;
};

StatusOr<Picture> ParseSize(const std::string& text) {
  Picture size;
  if (text.empty()) return size;
  char times = 0, rest = 0;
  const int read = std::sscanf(text.c_str(), "%d%c%d%c", &size.width, &times, &size.height, &rest);
  if (read != 3 || times != 'x' || size.width < 1 || size.height < 1 || size.width > 20000 || size.height > 20000) {
    return InputError("--size", "", text, "WIDTHxHEIGHT in pixels, each 1 to 20000, such as 1600x1200");
  }
  size.given = true;
  return size;
}

// Class colours without a scene: ground, facade, roof, vegetation as in the paper, then others.
std::vector<SceneClass> DefaultClasses() {
  const std::vector<std::pair<std::string, std::array<uint8_t, 3>>> known = {
      {"ground", {128, 128, 128}},   {"facade", {148, 82, 158}},  {"roof", {235, 196, 60}},
      {"vegetation", {88, 160, 72}}, {"class 4", {70, 130, 180}}, {"class 5", {200, 90, 60}},
      {"class 6", {90, 190, 190}},   {"class 7", {150, 110, 80}}};
  std::vector<SceneClass> classes;
  for (const auto& [name, color] : known) {
    SceneClass c;
    c.name = name;
    c.color_rgb = color;
    classes.push_back(c);
  }
  return classes;
}

struct World {
  std::optional<SceneDescription> scene;
  Frame frame;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<SceneClass> classes = DefaultClasses();
};

StatusOr<World> LoadWorld(const std::string& scene_path) {
  World world;
  if (scene_path.empty()) return world;
  Warnings warnings;
  SceneLoadOptions load;
  load.skip_images = kMaxSkippedShare;  // a job may have left images out, and no photograph is read
  TESSERA_ASSIGN_OR_RETURN(world.scene, LoadScene(scene_path, &warnings, load));
  PrintWarnings(warnings);
  world.frame = world.scene->frame;
  world.up = world.scene->up_in_local;
  world.classes = world.scene->classes;
  return world;
}

StatusOr<TriangleMesh> ReadMeshInWorld(const std::string& path, const World& world) {
  Warnings warnings;
  MeshReadOptions options = {{}, &warnings, path};
  if (world.scene) options.label_property = LabelPropertyOf(*world.scene, path);
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path, options));
  PrintWarnings(warnings);
  if (content.mesh.faces.empty()) return InputError(path, "", "no faces", "at least one");
  for (Eigen::Vector3d& v : content.mesh.vertices) v = world.frame.LocalFromScene(v);
  return std::move(content.mesh);
}

StatusOr<PosedCamera> SceneCamera(const World& world, const std::string& name, const Picture& size) {
  if (!world.scene) {
    return InputError("--view", "", name, "nadir, oblique, or the name of an image together with --scene");
  }
  for (const SceneView& view : world.scene->views) {
    if (view.name != name && fs::path(view.name).stem() != name) continue;
    PosedCamera camera = view.camera;
    if (size.given) {
      // Fit the whole view into the picture and keep its aspect ratio.
      const PinholeCamera old = camera.intrinsics;
      const double scale = std::min(1.0 * size.width / old.width, 1.0 * size.height / old.height);
      camera.intrinsics = {size.width,
                           size.height,
                           old.fx * scale,
                           old.fy * scale,
                           (old.cx - 0.5 * old.width) * scale + 0.5 * size.width,
                           (old.cy - 0.5 * old.height) * scale + 0.5 * size.height};
    }
    return camera;
  }
  return InputError("--view", "", name,
                    "nadir, oblique or one of the scene's " + std::to_string(world.scene->views.size()) +
                        " images, such as " + (world.scene->views.empty() ? "" : world.scene->views[0].name));
}

StatusOr<PosedCamera> ChooseCamera(const RenderArguments& arguments, const World& world, const TriangleMesh& mesh) {
  TESSERA_ASSIGN_OR_RETURN(const Picture size, ParseSize(arguments.size));
  constexpr double kRadians = std::numbers::pi / 180;
  PosedCamera camera;
  if (arguments.view == "nadir") {
    camera = NadirCamera(mesh, world.up, size.width, size.height);
  } else if (arguments.view == "oblique") {
    camera = ObliqueCamera(mesh, world.up, arguments.azimuth_deg * kRadians, arguments.pitch_deg * kRadians, size.width,
                           size.height);
  } else {
    TESSERA_ASSIGN_OR_RETURN(camera, SceneCamera(world, arguments.view, size));
  }
  if (!arguments.zoom.empty()) {
    camera.intrinsics = Zoomed(camera.intrinsics, arguments.zoom[0], arguments.zoom[1], arguments.zoom[2]);
  }
  return camera;
}

// The mesh that the mode compares with, and its search tree.
struct Reference {
  TriangleMesh mesh;
  std::optional<NearestSurface> surface;
};

StatusOr<std::unique_ptr<Reference>> LoadReference(const RenderArguments& arguments, const World& world) {
  auto reference = std::make_unique<Reference>();
  std::string path;
  if (arguments.mode == Mode::kDisplacement) {
    path = arguments.reference;
    if (path.empty() && world.scene) path = (fs::path(world.scene->folder) / world.scene->mesh_path).string();
    if (path.empty()) return InputError("--mode displacement", "", "no --reference and no --scene", "one of them");
  } else if (arguments.mode == Mode::kErrors) {
    path = arguments.truth;
    if (path.empty() && world.scene) path = (fs::path(world.scene->folder) / "truth" / "mesh.ply").string();
    if (path.empty()) return InputError("--mode errors", "", "no --truth and no --scene", "one of them");
  } else {
    return reference;
  }
  TESSERA_ASSIGN_OR_RETURN(reference->mesh, ReadMeshInWorld(path, world));
  if (arguments.mode == Mode::kErrors && reference->mesh.labels.empty()) {
    return InputError(path, "", "faces without labels", "labels, to compare with");
  }
  reference->surface.emplace(reference->mesh);
  return reference;
}

SurfaceColor ColorFor(Mode mode, const TriangleMesh& mesh, const Reference& reference, const Palette& palette,
                      double range_m) {
  switch (mode) {
    case Mode::kLabels:
      return LabelColor(mesh, palette);
    case Mode::kErrors:
      return LabelErrorColor(mesh, reference.mesh, *reference.surface);
    case Mode::kDisplacement:
      return DisplacementColor(reference.mesh, *reference.surface, range_m);
    case Mode::kNormals:
      return NormalColor(mesh);
    case Mode::kShaded:
      break;
  }
  return UniformColor(Color(0.86f, 0.85f, 0.82f));
}

StatusOr<int> RenderPicture(const RenderArguments& arguments) {
  const ThreadLimit limit(arguments.threads);
  TESSERA_ASSIGN_OR_RETURN(const World world, LoadWorld(arguments.scene));
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, ReadMeshInWorld(arguments.mesh, world));
  TESSERA_ASSIGN_OR_RETURN(const PosedCamera camera, ChooseCamera(arguments, world, mesh));
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<Reference> reference, LoadReference(arguments, world));
  std::optional<TriangleMesh> other;
  if (!arguments.compare.empty()) {
    TESSERA_ASSIGN_OR_RETURN(other, ReadMeshInWorld(arguments.compare, world));
  }
  const bool needs_labels = arguments.mode == Mode::kLabels || arguments.mode == Mode::kErrors;
  for (const TriangleMesh* m : {&mesh, other ? &*other : &mesh}) {
    if (needs_labels && m->labels.empty()) {
      return InputError(m == &mesh ? arguments.mesh : arguments.compare, "", "faces without labels",
                        "labels for this --mode");
    }
  }
  double range_m = 1;
  if (arguments.mode == Mode::kDisplacement) {
    range_m = arguments.range_m.value_or(DisplacementRange(mesh, *reference->surface));
  }
  Palette palette;
  for (const SceneClass& c : world.classes) palette.push_back(c.color_rgb);
  RenderOptions options;
  options.samples_per_axis = arguments.samples_per_axis;
  options.occlusion_rays = arguments.occlusion_rays;
  options.lit = !arguments.plain && arguments.mode != Mode::kNormals;
  options.edges = arguments.edges;
  options.up = world.up;
  const auto render = [&](const TriangleMesh& m) {
    return Render(m, RayCaster(m), camera, ColorFor(arguments.mode, m, *reference, palette, range_m), options);
  };

  ByteImage picture = render(mesh);
  if (other) {
    ByteImage before = render(*other);
    if (!arguments.captions.empty()) DrawCaption(&before, arguments.captions.front());
    if (arguments.captions.size() > 1) DrawCaption(&picture, arguments.captions.back());
    picture = SideBySide(before, picture);
  } else if (!arguments.captions.empty()) {
    DrawCaption(&picture, arguments.captions.front());
  }
  if (arguments.mode == Mode::kDisplacement) DrawDisplacementBar(&picture, range_m);
  if (arguments.mode == Mode::kLabels && world.scene) {
    std::vector<std::pair<std::string, std::array<uint8_t, 3>>> entries;
    for (const SceneClass& c : world.classes) entries.emplace_back(c.name, c.color_rgb);
    DrawLegend(&picture, entries);
  }
  TESSERA_RETURN_IF_ERROR(WritePng(arguments.out, picture));
  return kExitOk;
}

}  // namespace

void AddRenderCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<RenderArguments>();
  CLI::App* command = app.add_subcommand("render", "Render a mesh to a PNG picture");
  command->footer(
      "Examples:\n"
      "  tessera render out/mesh.ply --out after.png\n"
      "  tessera render out/mesh.ply --scene city --mode labels --view nadir --out labels.png\n"
      "  tessera render out/mesh.ply --compare city/mesh.ply --caption before --caption after --out both.png\n"
      "  tessera render out/mesh.ply --scene city --mode displacement --zoom 0.5,0.4,0.25 --out moved.png\n"
      "  tessera render out/mesh.ply --scene city --mode errors --view 0003.jpg --out wrong.png");
  command
      ->add_option("mesh", arguments->mesh,
                   "Mesh to render, PLY or OBJ; in the scene's coordinates if --scene is given")
      ->required();
  command->add_option("--out", arguments->out, "PNG file to write")->required();
  command->add_option("--scene", arguments->scene,
                      "Scene for class colours, up direction, views, start mesh and truth");
  command->add_option("--compare", arguments->compare, "Second mesh, drawn on the left from the same camera");
  command
      ->add_option(
          "--mode", arguments->mode_name,
          "Colouring: shaded; labels (class colours); errors (wrong labels red); displacement (signed distance "
          "from the reference, red outwards, blue inwards); normals")
      ->check(CLI::IsMember(kModeNames))
      ->capture_default_str();
  command->add_option("--view", arguments->view, "Camera: nadir, oblique, or the name of an image of the scene")
      ->capture_default_str();
  command
      ->add_option("--azimuth", arguments->azimuth_deg,
                   "Viewing azimuth of --view oblique, degrees clockwise from north")
      ->capture_default_str();
  command->add_option("--pitch", arguments->pitch_deg, "Viewing angle of --view oblique, degrees below the horizon")
      ->check(CLI::Range(1.0, 89.0))
      ->capture_default_str();
  command
      ->add_option("--size", arguments->size,
                   "Picture size, WIDTHxHEIGHT in pixels (default 1600x1200, or the image's)")
      ->check([](const std::string& text) {
        return ParseSize(text).ok() ? std::string() : text + " is not WIDTHxHEIGHT in pixels, such as 1600x1200";
      });
  command
      ->add_option("--zoom", arguments->zoom,
                   "Part of the picture to show, X,Y,SHARE: centre and width as fractions, 0 to 1")
      ->delimiter(',')
      ->expected(3)
      ->check(CLI::Range(1e-4, 1.0));
  command->add_option("--reference", arguments->reference,
                      "Reference mesh of --mode displacement (default: the scene's start mesh)");
  command
      ->add_option("--range", arguments->range_m,
                   "Displacement of full colour, metres (default: computed from the mesh)")
      ->check(CLI::PositiveNumber);
  command->add_option("--truth", arguments->truth, "Labelled mesh of --mode errors (default SCENE/truth/mesh.ply)");
  command->add_option("--caption", arguments->captions, "Text in the corner; give it twice with --compare, left first");
  command->add_flag("--edges", arguments->edges, "Draw the edges of the faces");
  command->add_flag("--plain", arguments->plain, "Draw colours without lighting");
  command->add_option("--antialias", arguments->samples_per_axis, "Rays per pixel along each axis")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  command->add_option("--occlusion-rays", arguments->occlusion_rays, "Ambient occlusion rays per camera ray; 0: none")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command->add_option("--threads", arguments->threads, "Number of threads; 0: one per core")
      ->check(CLI::NonNegativeNumber);
  SetAction(command, exit_code, [arguments] {
    const auto name = std::find(kModeNames.begin(), kModeNames.end(), arguments->mode_name);
    arguments->mode = static_cast<Mode>(name - kModeNames.begin());
    return RenderPicture(*arguments);
  });
}

}  // namespace tessera
