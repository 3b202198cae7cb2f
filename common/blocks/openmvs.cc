// Conventions of the interface format, from the comments and functions of OpenMVS's libs/MVS/Interface.h:
// - A platform carries cameras; image i has platform, camera and pose. Its rotation world -> camera is R_camera R_pose,
//   its centre R_pose^T C_camera + C_pose (Platform::GetPose). x right, y down, z forward.
// - K is in pixels for the camera's width and height. Without these it is in shares of max(width, height) (GetFullK).
// - "integer coordinates is by convention the pixel center": our coordinates are larger by half a pixel.
// - Matrices are stored row by row, numbers little-endian, and images are undistorted: K has no distortion.
// - X_relative = transform X_absolute is optional; the poses are relative.
#include "common/blocks/openmvs.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/blocks/block_parts.h"
#include "common/storage/files.h"
#include "common/storage/mapped_file.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little, "files of OpenMVS are little-endian");

constexpr uint32_t kMvsNoId = 0xffffffff;
constexpr uint32_t kMvsNewestVersion = 7;
constexpr size_t kMvsMaxFaults = 100;  // a damaged file does not get a message for each of its points
constexpr double kMvsRotationTolerance = 1e-3;
constexpr double kMvsLargest = 1e12;  // of numbers, so that products stay finite

using MvsMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using MvsMatrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

// Reads values from the file. After the first fault ok() is false and all values are zero.
class MvsReader {
 public:
  MvsReader(std::string_view bytes, const std::string& file, Faults* faults)
      : bytes_(bytes), file_(file), faults_(*faults) {}

  template <class T>
  T Read(std::string_view what) {
    T value{};
    if (Take(sizeof(T), what)) std::memcpy(&value, bytes_.data() + at_ - sizeof(T), sizeof(T));
    return value;
  }
  template <class Matrix>
  Matrix ReadDoubles(std::string_view what) {
    Matrix value = Matrix::Zero();
    constexpr size_t kSize = sizeof(double) * Matrix::SizeAtCompileTime;
    if (Take(kSize, what)) std::memcpy(value.data(), bytes_.data() + at_ - kSize, kSize);
    return value;
  }
  std::string ReadText(std::string_view what) {
    const uint64_t size = ReadCount(1, what);
    return Take(size, what) ? std::string(bytes_.substr(at_ - size, size)) : "";
  }
  // A number of entries of at least `smallest_bytes` each, which the rest of the file can hold.
  uint64_t ReadCount(uint64_t smallest_bytes, std::string_view what) {
    const size_t begin = at_;
    const auto count = Read<uint64_t>(what);
    if (!ok_ || count <= left() / smallest_bytes) return ok_ ? count : 0;
    Fail(begin, absl::StrCat("a size of ", count, " for ", std::string(what)),
         absl::StrCat("at most ", left() / smallest_bytes, ", which fit in the file"));
    return 0;
  }
  void Skip(uint64_t count, uint64_t size_bytes, std::string_view what) {
    if (count <= left() / size_bytes)
      Take(count * size_bytes, what);
    else
      Take(bytes_.size(), what);
  }
  void Fail(size_t at, const std::string& found, const std::string& expected) {
    if (ok_) faults_.Add(InputError(file_, absl::StrCat("byte ", at), found, expected));
    ok_ = false;
  }
  bool ok() const { return ok_; }
  size_t at() const { return at_; }
  size_t left() const { return bytes_.size() - at_; }

 private:
  bool Take(uint64_t size, std::string_view what) {
    if (ok_ && size > left())
      Fail(bytes_.size(), "the end of the file", absl::StrCat(std::string(what), "; the file is cut"));
    if (ok_) at_ += size;
    return ok_;
  }
  std::string_view bytes_;
  const std::string& file_;
  Faults& faults_;
  size_t at_ = 0;
  bool ok_ = true;
};

struct MvsCamera {
  std::string name;
  uint32_t width = 0, height = 0;
  MvsMatrix3 K, R;
  Eigen::Vector3d C;
};

struct MvsPose {
  MvsMatrix3 R;
  Eigen::Vector3d C;
};

struct MvsPlatform {
  std::vector<MvsCamera> cameras;
  std::vector<MvsPose> poses;
};

struct MvsImage {
  std::string name;
  uint32_t platform = kMvsNoId, camera = kMvsNoId, pose = kMvsNoId;
};

struct MvsScene {
  std::vector<MvsPlatform> platforms;
  std::vector<MvsImage> images;
  uint64_t points = 0, lines = 0;
  MvsMatrix4 transform = MvsMatrix4::Identity();
};

MvsPlatform ReadMvsPlatform(MvsReader& in, uint32_t version, size_t number) {
  const std::string what = absl::StrCat("platform ", number);
  MvsPlatform platform;
  in.ReadText(what + "'s name");
  const uint64_t cameras = in.ReadCount(8 + 21 * 8, what + "'s cameras");
  for (uint64_t i = 0; i < cameras && in.ok(); ++i) {
    const std::string of_camera = absl::StrCat("camera ", i, " of ", what);
    MvsCamera camera;
    camera.name = in.ReadText(of_camera);
    if (version > 3) in.ReadText(of_camera);  // the band
    camera.width = in.Read<uint32_t>(of_camera);
    camera.height = in.Read<uint32_t>(of_camera);
    camera.K = in.ReadDoubles<MvsMatrix3>(of_camera);
    camera.R = in.ReadDoubles<MvsMatrix3>(of_camera);
    camera.C = in.ReadDoubles<Eigen::Vector3d>(of_camera);
    platform.cameras.push_back(camera);
  }
  const uint64_t poses = in.ReadCount(12 * 8, what + "'s poses");
  for (uint64_t i = 0; i < poses && in.ok(); ++i) {
    MvsPose pose;
    pose.R = in.ReadDoubles<MvsMatrix3>(what);
    pose.C = in.ReadDoubles<Eigen::Vector3d>(what);
    platform.poses.push_back(pose);
  }
  return platform;
}

MvsImage ReadMvsImage(MvsReader& in, uint32_t version, size_t number) {
  const std::string what = absl::StrCat("image ", number);
  MvsImage image;
  image.name = in.ReadText(what);
  if (version > 4) in.ReadText(what);  // the mask
  image.platform = in.Read<uint32_t>(what);
  image.camera = in.Read<uint32_t>(what);
  image.pose = in.Read<uint32_t>(what);
  if (version > 2) in.Read<uint32_t>(what);  // the id outside of this scene
  if (version > 6) {
    in.Skip(3, sizeof(float), what);  // depths
    in.Skip(in.ReadCount(24, what + "'s view scores"), 24, what);
  }
  return image;
}

// Skips the points, or the lines, of `position_bytes` each and the views that see them, after a check of the views.
uint64_t SkipMvsPoints(MvsReader& in, uint64_t position_bytes, uint64_t images, std::string_view what) {
  const uint64_t count = in.ReadCount(position_bytes + 8, what);
  for (uint64_t i = 0; i < count && in.ok(); ++i) {
    in.Skip(1, position_bytes, what);
    const uint64_t views = in.ReadCount(8, what);
    for (uint64_t k = 0; k < views && in.ok(); ++k) {
      const size_t at = in.at();
      const auto image = in.Read<uint32_t>(what);
      in.Skip(1, sizeof(float), what);
      if (image >= images) in.Fail(at, absl::StrCat("image ", image), absl::StrCat("one of ", images, " images"));
    }
  }
  return count;
}

// Skips attributes of points or lines: none, or one each.
void SkipMvsAttributes(MvsReader& in, uint64_t owners, uint64_t size_bytes, std::string_view what) {
  const size_t at = in.at();
  const uint64_t count = in.ReadCount(size_bytes, what);
  in.Skip(count, size_bytes, what);
  if (in.ok() && count != 0 && count != owners)
    in.Fail(at, absl::StrCat(count, " of ", std::string(what)), absl::StrCat(owners, ", or none"));
}

MvsScene ReadMvsScene(MvsReader& in, uint32_t version) {
  MvsScene scene;
  const uint64_t platforms = in.ReadCount(3 * 8, "the platforms");
  for (uint64_t i = 0; i < platforms && in.ok(); ++i) scene.platforms.push_back(ReadMvsPlatform(in, version, i));
  const uint64_t images = in.ReadCount(8 + 3 * 4, "the images");
  for (uint64_t i = 0; i < images && in.ok(); ++i) scene.images.push_back(ReadMvsImage(in, version, i));
  scene.points = SkipMvsPoints(in, 3 * sizeof(float), images, "the points");
  SkipMvsAttributes(in, scene.points, 12, "the points' normals");
  SkipMvsAttributes(in, scene.points, 3, "the points' colours");
  scene.lines = SkipMvsPoints(in, 6 * sizeof(float), images, "the lines");
  SkipMvsAttributes(in, scene.lines, 12, "the lines' normals");
  SkipMvsAttributes(in, scene.lines, 3, "the lines' colours");
  if (version > 1) scene.transform = in.ReadDoubles<MvsMatrix4>("the transform");
  if (version > 5) in.Skip(15, sizeof(double), "the bounding box");
  if (in.ok() && in.left() > 0) in.Fail(in.at(), absl::StrCat(in.left(), " more bytes"), "the end of the file");
  return scene;
}

bool IsMvsPose(const MvsMatrix3& R, const Eigen::Vector3d& C) {
  return R.allFinite() && (R * R.transpose() - MvsMatrix3::Identity()).cwiseAbs().maxCoeff() <= kMvsRotationTolerance &&
         R.determinant() > 0 && C.allFinite() && C.cwiseAbs().maxCoeff() <= kMvsLargest;
}

// The nearest rotation.
Eigen::Matrix3d OrthonormalMvs(const Eigen::Matrix3d& R) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

Status CheckMvsCamera(const MvsCamera& camera, const std::string& file, const std::string& location) {
  const MvsMatrix3& K = camera.K;
  if (!K.allFinite() || K.cwiseAbs().maxCoeff() > kMvsLargest || !(K(0, 0) > 0) || !(K(1, 1) > 0) || K(1, 0) != 0 ||
      K(2, 0) != 0 || K(2, 1) != 0 || K(2, 2) != 1) {
    return InputError(file, location, "a matrix K that is no camera matrix", "[fx s cx; 0 fy cy; 0 0 1], fx, fy > 0");
  }
  if ((camera.width == 0) != (camera.height == 0) || camera.width > 1'000'000 || camera.height > 1'000'000)
    return InputError(file, location, absl::StrCat("an image size of ", camera.width, " x ", camera.height), "a size");
  if (!IsMvsPose(camera.R, camera.C))
    return InputError(file, location, "a matrix R or a position C that is no pose", "a rotation and a position");
  return absl::OkStatus();
}

bool HasMvsCameraWithoutSize(const MvsPlatform& platform) {
  return std::any_of(platform.cameras.begin(), platform.cameras.end(), [](const auto& c) { return c.width == 0; });
}

LensModel MvsLens(const MvsCamera& camera, const ImageSize& size) {
  const double scale = camera.width == 0 ? std::max(size.width, size.height) : 1;
  LensModel lens;
  lens.pinhole = {size.width,
                  size.height,
                  camera.K(0, 0) * scale,
                  camera.K(1, 1) * scale,
                  camera.K(0, 2) * scale + 0.5,
                  camera.K(1, 2) * scale + 0.5};
  if (camera.K(0, 1) == 0) return lens;
  lens.kind = LensModel::Kind::kBrown;
  lens.coefficients[6] = camera.K(0, 1) * scale;
  return lens;
}

// Adds the images of `scene` with their cameras to `block`.
void AddMvsImages(const MvsScene& scene, const std::string& file, const PhotographSize& image_size,
                  ImportedBlock* block, Faults* faults) {
  const auto fault = [&](const Status& status) {
    if (faults->messages().size() < kMvsMaxFaults) faults->Add(status);
  };
  std::map<std::pair<uint32_t, uint32_t>, bool> usable;             // by platform and camera
  std::map<std::tuple<uint32_t, uint32_t, int, int>, int> cameras;  // and image size: index of block->cameras
  size_t without_camera = 0, without_pose = 0;
  std::map<std::string, size_t> numbers;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const MvsImage& from = scene.images[i];
    const std::string location = absl::StrCat("image ", i, " (", Printable(from.name), ")");
    if (from.name.empty()) fault(InputError(file, location, "no name", "the name of the image's file"));
    if (const auto [first, added] = numbers.emplace(from.name, i); !added)
      fault(InputError(file, location, "the name of another image",
                       absl::StrCat("a name that image ", first->second, " does not have")));
    if (from.platform == kMvsNoId || from.camera == kMvsNoId) {
      ++without_camera;
      continue;
    }
    if (from.platform >= scene.platforms.size() || from.camera >= scene.platforms[from.platform].cameras.size()) {
      fault(InputError(file, location, absl::StrCat("camera ", from.camera, " of platform ", from.platform),
                       "a camera of the file"));
      continue;
    }
    const MvsPlatform& platform = scene.platforms[from.platform];
    const MvsCamera& camera = platform.cameras[from.camera];
    const auto [known, is_new] = usable.emplace(std::pair(from.platform, from.camera), true);
    if (is_new) {
      const Status status =
          CheckMvsCamera(camera, file, absl::StrCat("camera ", from.camera, " of platform ", from.platform));
      known->second = status.ok();
      fault(status);
    }
    if (!known->second) continue;
    ImageSize size = {static_cast<int>(camera.width), static_cast<int>(camera.height)};
    if (camera.width == 0) {
      const StatusOr<ImageSize> found = image_size(from.name);
      if (!found.ok()) {
        fault(ImageSizeFault(file, location, from.name, found.status(), block));
        continue;
      }
      size = *found;
    }
    const auto [at, new_camera] = cameras.emplace(std::tuple(from.platform, from.camera, size.width, size.height),
                                                  static_cast<int>(block->cameras.size()));
    if (new_camera) block->cameras.push_back({camera.name, MvsLens(camera, size)});
    BlockImage image;
    image.path = from.name;
    image.location = location;
    image.camera = at->second;
    image.oriented = from.pose != kMvsNoId;
    if (!image.oriented) ++without_pose;
    if (image.oriented) {
      if (from.pose >= platform.poses.size()) {
        fault(InputError(file, location, absl::StrCat("pose ", from.pose),
                         absl::StrCat("one of ", platform.poses.size(), " poses of platform ", from.platform)));
        continue;
      }
      const MvsPose& pose = platform.poses[from.pose];
      if (!IsMvsPose(pose.R, pose.C)) {
        fault(InputError(file, location, absl::StrCat("a pose ", from.pose, " that is no rotation and position"),
                         "an orthonormal matrix R and finite numbers"));
        continue;
      }
      image.rotation_cam_from_block = OrthonormalMvs(camera.R * pose.R);
      image.centre = pose.R.transpose() * camera.C + pose.C;
    }
    block->images.push_back(image);
  }
  if (without_camera > 0) block->left_out.push_back(absl::StrCat(without_camera, " images without a camera"));
  if (without_pose > 0) block->left_out.push_back(absl::StrCat("the missing poses of ", without_pose, " images"));
}

}  // namespace

bool IsOpenMvs(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return false;
  const StatusOr<std::string> head = ReadFileRange(path, 0, 4);
  return head.ok() && (*head == "MVSI" || *head == std::string("MVS\0", 4));
}

ImportedBlock ParseOpenMvs(std::string_view bytes, const std::string& file, const PhotographSize& image_size,
                           Faults* faults) {
  ImportedBlock block;
  block.files = {file};
  if (bytes.starts_with(std::string_view("MVS\0", 4))) {
    faults->Add(InputError(file, "", "an OpenMVS project",
                           "a scene in OpenMVS's interface format (MVSI), as InterfaceCOLMAP, InterfaceOpenMVG, "
                           "InterfaceMetashape or OpenSfM's export_openmvs write it, before DensifyPointCloud; "
                           "or the block of the program that adjusted it"));
    return block;
  }
  if (!bytes.starts_with("MVSI")) {
    faults->Add(InputError(file, "byte 0", "another beginning", "MVSI"));
    return block;
  }
  MvsReader in(bytes, file, faults);
  in.Skip(1, 4, "the header");
  const auto version = in.Read<uint32_t>("the version");
  in.Read<uint32_t>("the header");
  if (in.ok() && (version == 0 || version > kMvsNewestVersion)) {
    in.Fail(4, absl::StrCat("version ", version, " of the interface"), absl::StrCat("1 to ", kMvsNewestVersion));
  }
  block.version = absl::StrCat(version);
  const MvsScene scene = in.ok() ? ReadMvsScene(in, version) : MvsScene();
  if (!in.ok()) return block;
  AddMvsImages(scene, file, image_size, &block, faults);
  if (scene.images.empty()) faults->Add(InputError(file, "", "no images", "a scene with images"));
  block.conventions = {
      "The rotation of an image is that of its camera times that of its pose, from the world to the camera, by rows.",
      "Image coordinates have half a pixel added: OpenMVS counts from the centre of the first pixel.",
      "The images are the undistorted ones of OpenMVS, without lens distortion."};
  if (std::any_of(scene.platforms.begin(), scene.platforms.end(), HasMvsCameraWithoutSize))
    block.conventions.push_back("Camera matrices without an image size are in shares of the longer side.");
  if (scene.points > 0) {
    block.left_out.push_back(absl::StrCat(scene.points,
                                          " points: they name their images, not the positions in them, "
                                          "so they prove nothing"));
  }
  if (scene.lines > 0) block.left_out.push_back(absl::StrCat(scene.lines, " lines"));
  if (scene.transform != MvsMatrix4::Identity() && scene.transform != MvsMatrix4::Zero()) {
    block.left_out.push_back(
        "the transform from absolute coordinates: positions are those of the file; it names no "
        "reference system");
  }
  return block;
}

ImportedBlock ReadOpenMvs(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings*) {
  const std::string file = AbsolutePath(path);
  const StatusOr<MappedFile> content = MappedFile::Open(file);
  if (!content.ok()) {
    faults->Add(content.status());
    return {};
  }
  PhotographFiles files(file, options.photographs);
  return ParseOpenMvs(
      {content->data(), content->size_bytes()}, file, [&files](const std::string& name) { return files.SizeOf(name); },
      faults);
}

}  // namespace tessera
