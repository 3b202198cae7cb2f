#include "common/blocks/blocks_exchange/blocks_exchange.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <filesystem>
#include <map>
#include <numbers>
#include <unordered_map>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/blocks/block_parts.h"
#include "common/blocks/blocks_exchange/blocks_exchange_lens.h"
#include "common/storage/files.h"
#include "common/storage/xml_file.h"
#include "common/storage/zip_file.h"

namespace tessera {
namespace {

constexpr int64_t kExchangeHeadBytes = 1 << 16;
constexpr char kExchangeRoot[] = "BlocksExchange";

std::string QuotedExchange(std::string_view text) {
  return absl::StrCat("'", Printable(Prefix(text, 80)), text.size() > 80 ? "..." : "", "'");
}

// Conventions, documented at https://developer.bentley.com/apis/contextcapture/cc-ori/ and in the comments of
// ContextCapture's sample of Paris, against which they were checked (tie point .03 px):
//   Rotation: world to camera, in the axes of CameraOrientation; M_ij is row i, column j. Or Omega, Phi, Kappa in
//   degrees with R = (Rx(Omega) Ry(Phi) Rz(Kappa))^T. Center: the camera's position. Both in the system of SRSId of the
//   photogroup, else of the block; without one, in a local Cartesian system. Pose/Metadata has the values of GPS and
//   IMU. A pose without rotation is a position only.
//   Measurement: x, y in pixels, the first pixel's centre is (0, 0); or xmm, ymm from the principal point, along the
//   axes of CameraOrientation.
class ExchangeReader {
 public:
  ExchangeReader(const std::string& name, const ExchangeLoader& load, const BlockReadOptions& options,
                 ImportedBlock* block, Faults* faults, Warnings* warnings)
      : name_(name), load_(load), options_(options), block_(*block), faults_(faults), warnings_(*warnings) {}

  void Read(const XmlNode& root) {
    if (root.Name() != kExchangeRoot) {
      root.AddFault(absl::StrCat("the root element ", QuotedExchange(root.Name())), kExchangeRoot, faults_);
      return;
    }
    block_.version = root.Attribute("version").value_or("");
    if (block_.version < "2.1" || block_.version > "3.2") {
      warnings_.push_back(absl::StrCat(name_, ": BlocksExchange version ", QuotedExchange(block_.version),
                                       " is read like 3.2; 2.1 to 3.2 are known"));
    }
    ReadSystems(root.Child("SpatialReferenceSystems"));
    base_path_ = root.Child("BaseImagePath").Text();
    const XmlNode node = root.Child("Block");
    if (!node || node.Next("Block")) {
      root.AddFault(node ? "several blocks" : "no element Block", "one Block; export a single block", faults_);
      return;
    }
    const std::string block_system = SystemOf(node, "");
    const XmlNode groups = node.Child("Photogroups");
    for (XmlNode group = groups.Child("Photogroup"); group; group = group.Next("Photogroup")) {
      ReadGroup(group, block_system);
    }
    if (block_.images.empty()) {
      groups.AddFault("no Photogroup with photographs",
                      node.Child("BulkPhotos") ? "photogroups; export the block after aerotriangulation" : "some",
                      faults_);
    }
    ChooseSystem(block_system);
    ChooseComponent(options_.component, name_, &block_, faults_);
    ReadControlPoints(node.Child("ControlPoints"), block_system);
    ReadTiePoints(node.Child("TiePoints"), block_system);
    Finish(node);
  }

 private:
  void ReadSystems(const XmlNode& systems) {
    for (XmlNode system = systems.Child("SRS"); system; system = system.Next("SRS")) {
      const std::optional<int64_t> id = system.ChildInteger("Id", faults_);
      std::string definition(system.Child("Definition").Text());
      if (definition.empty()) system.AddFault("no Definition", "EPSG:N, ENU:LAT,LON, WKT or a PROJ string", faults_);
      if (definition.starts_with("EPSG:")) std::erase(definition, ' ');
      if (definition == "WGS84") definition = "EPSG:4326";
      if (definition.starts_with("LOCAL_CS")) definition.clear();
      if (id && !systems_.emplace(*id, definition).second) {
        system.AddFault(absl::StrCat("a second SRS ", *id), "each Id once", faults_);
      }
    }
  }

  // The definition of the system that SRSId of `node` names, else `inherited`.
  std::string SystemOf(const XmlNode& node, const std::string& inherited) {
    const XmlNode child = node.Child("SRSId");
    const std::optional<int64_t> id = child ? child.Integer(faults_) : std::nullopt;
    if (!id) return inherited;
    const auto found = systems_.find(*id);
    if (found != systems_.end()) return found->second;
    child.AddFault(absl::StrCat("SRS ", *id), "one that SpatialReferenceSystems has", faults_);
    return inherited;
  }

  void ReadGroup(const XmlNode& group, const std::string& block_system) {
    if (!group.Child("Photo")) return;
    ExchangeCamera camera;
    const bool manual_optics = group.Child("ManualOpticalParams").Text() != "false";
    if (!manual_optics) {
      group.Child("ManualOpticalParams")
          .AddFault("'false': the file has no camera", "a block after aerotriangulation", faults_);
    } else {
      ReadExchangeCamera(group, &camera, faults_);
    }
    const int index = static_cast<int>(cameras_.size());
    if (camera.camera.name.empty()) camera.camera.name = absl::StrCat("photogroup ", index);
    cameras_.push_back(camera);
    block_.cameras.push_back(camera.camera);
    const bool manual_pose = group.Child("ManualPose").Text() != "false";
    const std::string system = SystemOf(group, block_system);
    for (XmlNode photo = group.Child("Photo"); photo; photo = photo.Next("Photo")) {
      BlockImage image;
      image.camera = index;
      image.location = photo.Location();
      image.path = JoinBase(std::string(photo.Child("ImagePath").Text()));
      if (image.path.empty()) photo.AddFault("no ImagePath", "the path of the photograph", faults_);
      // 1 is the main component and the default, 0 is none.
      const XmlNode component = photo.Child("Component");
      const int64_t number = component ? component.Integer(faults_).value_or(1) : 1;
      if (number < 0 || number > 1'000'000'000) {
        component.AddFault(absl::StrCat(number), "the number of a component", faults_);
      } else {
        image.component = number == 0 ? -1 : static_cast<int>(number);
      }
      image.oriented = manual_pose && ReadPose(photo.Child("Pose"), camera, &image);
      if (image.oriented) ++images_in_[system];
      const std::optional<int64_t> id = photo.ChildInteger("Id", faults_);
      if (id && !images_.emplace(*id, block_.images.size()).second) {
        photo.AddFault(absl::StrCat("a second photograph ", *id), "each Id once", faults_);
      }
      masks_ += !photo.Child("MaskPath").Text().empty();
      block_.images.push_back(image);
    }
  }

  std::string JoinBase(const std::string& path) const {
    const bool is_absolute = path.starts_with('/') || path.starts_with('\\') || (path.size() > 1 && path[1] == ':');
    if (path.empty() || is_absolute || base_path_.empty()) return path;
    const char separator = base_path_.find('\\') != std::string::npos ? '\\' : '/';
    return absl::StrCat(base_path_, base_path_.back() == separator ? "" : std::string(1, separator), path);
  }

  // False if it has no orientation.
  bool ReadPose(const XmlNode& pose, const ExchangeCamera& camera, BlockImage* image) {
    metadata_ += static_cast<bool>(pose.Child("Metadata"));
    const XmlNode rotation = pose.Child("Rotation"), centre = pose.Child("Center");
    if (!rotation || !centre) return false;
    Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
    if (!ReadPosition(centre, &image->centre) || !ReadRotation(rotation, &matrix)) return false;
    image->rotation_cam_from_block = camera.axes * matrix;
    inaccurate_ += rotation.Child("Accurate").Text() == "false";
    return true;
  }

  bool ReadRotation(const XmlNode& rotation, Eigen::Matrix3d* matrix) {
    if (rotation.Child("Omega")) {
      const std::optional<double> omega = rotation.ChildNumber("Omega", faults_);
      const std::optional<double> phi = rotation.ChildNumber("Phi", faults_);
      const std::optional<double> kappa = rotation.ChildNumber("Kappa", faults_);
      if (!omega || !phi || !kappa) return false;
      constexpr double kDegree = std::numbers::pi / 180;
      const Eigen::Matrix3d world_from_camera = (Eigen::AngleAxisd(*omega * kDegree, Eigen::Vector3d::UnitX()) *
                                                 Eigen::AngleAxisd(*phi * kDegree, Eigen::Vector3d::UnitY()) *
                                                 Eigen::AngleAxisd(*kappa * kDegree, Eigen::Vector3d::UnitZ()))
                                                    .toRotationMatrix();
      *matrix = world_from_camera.transpose();
      return true;
    }
    if (!rotation.Child("M_00")) {
      rotation.AddFault(rotation.Child("Heading") ? "Heading, Pitch and Roll" : "no angles and no matrix",
                        "a matrix or Omega, Phi, Kappa; choose one of them at the export", faults_);
      return false;
    }
    static constexpr const char* kNames[3][3] = {
        {"M_00", "M_01", "M_02"}, {"M_10", "M_11", "M_12"}, {"M_20", "M_21", "M_22"}};
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        const std::optional<double> value = rotation.ChildNumber(kNames[row][column], faults_);
        if (!value) return false;
        (*matrix)(row, column) = *value;
      }
    }
    if (MakeRotation(matrix)) return true;
    rotation.AddFault("a matrix that is no rotation", "orthonormal rows to 0.001, determinant 1", faults_);
    return false;
  }

  bool ReadPosition(const XmlNode& node, Eigen::Vector3d* position) {
    const std::optional<double> x = node.ChildNumber("x", faults_), y = node.ChildNumber("y", faults_);
    const std::optional<double> z = node.ChildNumber("z", faults_);
    if (!x || !y || !z) return false;
    *position = {*x, *y, *z};
    return true;
  }

  // The system of the poses.
  void ChooseSystem(const std::string& block_system) {
    block_.crs = images_in_.empty() ? block_system : images_in_.begin()->first;
    if (images_in_.size() > 1) {
      faults_->Add(InputError(
          name_, "/BlocksExchange/Block/Photogroups",
          absl::StrCat("poses in ", images_in_.size(), " systems: ", QuotedExchange(images_in_.begin()->first), ", ",
                       QuotedExchange(std::next(images_in_.begin())->first)),
          "one system for all photogroups; choose it at the export"));
    }
  }

  // Adds the point's measurements. False if the point is of no use.
  void ReadMeasurements(const XmlNode& node, BlockTiePoint* point) {
    std::unordered_set<int> seen;
    for (XmlNode item = node.Child("Measurement"); item; item = item.Next("Measurement")) {
      const std::optional<int64_t> id = item.ChildInteger("PhotoId", faults_);
      if (!id) continue;
      const auto found = images_.find(*id);
      if (found == images_.end()) {
        ++unknown_photos_;
        continue;
      }
      const int image = static_cast<int>(found->second);
      const ExchangeCamera& camera = cameras_[block_.images[image].camera];
      const bool in_mm = !item.Child("x") && item.Child("xmm");
      const std::optional<double> x = item.ChildNumber(in_mm ? "xmm" : "x", faults_);
      const std::optional<double> y = item.ChildNumber(in_mm ? "ymm" : "y", faults_);
      if (!x || !y) continue;
      if (in_mm && camera.pixel_mm == 0) {
        item.AddFault("millimetres without the size of a pixel", "SensorSize or PixelSize in the photogroup", faults_);
        continue;
      }
      if (!seen.insert(image).second) {
        item.AddFault(absl::StrCat("a second measurement in photograph ", *id), "one a photograph", faults_);
        continue;
      }
      const PinholeCamera& pinhole = camera.camera.lens.pinhole;
      point->observations.push_back(
          {image, in_mm ? Eigen::Vector2d(Eigen::Vector2d(pinhole.cx, pinhole.cy) + camera.PixelsOf({*x, *y}))
                        : Eigen::Vector2d(*x + 0.5, *y + 0.5)});
    }
  }

  // `incomplete`: counts points without position; null: they are read too.
  void ReadPoint(const XmlNode& node, const std::string& system, std::vector<BlockTiePoint>* points, int64_t* others,
                 int64_t* incomplete) {
    const XmlNode position = node.Child("Position");
    const std::string_view category = node.Child("Category").Text();
    BlockTiePoint point;
    if (SystemOf(node, system) != block_.crs) {
      ++*others;
    } else if (incomplete != nullptr && (!position || (!category.empty() && category != "Full"))) {
      ++*incomplete;
    } else if (!position || ReadPosition(position, &point.position)) {
      ReadMeasurements(node, &point);
      points->push_back(std::move(point));
    }
  }

  void ReadControlPoints(const XmlNode& node, const std::string& block_system) {
    const std::string system = SystemOf(node, block_system);
    int64_t others = 0, incomplete = 0;
    for (XmlNode point = node.Child("ControlPoint"); point; point = point.Next("ControlPoint")) {
      ReadPoint(point, system, &block_.control_points, &others, &incomplete);
    }
    LeaveOut(others, "control points in another system than the poses");
    LeaveOut(incomplete, "control points without position or known in plan or height only");
  }

  void ReadTiePoints(const XmlNode& node, const std::string& block_system) {
    const std::string system = SystemOf(node, block_system);
    ReadTiePointList(node.Child("TiePoint"), system);
    if (const std::string path(node.Child("Path").Text()); !path.empty()) {
      StatusOr<std::string> text = load_(path);
      if (absl::IsNotFound(text.status())) {
        warnings_.push_back(
            absl::StrCat(name_, ": the file of tie points ", QuotedExchange(path),
                         " does not exist; put it beside the block, or the block cannot be proven by them"));
        block_.left_out.push_back(absl::StrCat("the tie points of ", Printable(path), ": the file does not exist"));
      } else if (!text.ok()) {
        faults_->Add(text.status());
      } else if (const StatusOr<XmlFile> file = XmlFile::Parse(*std::move(text), path); !file.ok()) {
        faults_->Add(file.status());
      } else if (file->Root().Name() == "TiePoint") {  // a file of many roots
        ReadTiePointList(file->Root(), system);
      } else if (file->Root().Name() == "TiePoints") {
        ReadTiePointList(file->Root().Child("TiePoint"), SystemOf(file->Root(), system));
      } else {
        file->Root().AddFault(absl::StrCat("the element ", QuotedExchange(file->Root().Name())), "TiePoint", faults_);
      }
    }
    LeaveOut(other_tie_points_, "tie points in another system than the poses");
  }

  void ReadTiePointList(XmlNode point, const std::string& system) {
    for (; point; point = point.Next("TiePoint")) {
      ReadPoint(point, system, &block_.points, &other_tie_points_, nullptr);
    }
  }

  void LeaveOut(int64_t count, const std::string& what) {
    if (count > 0) block_.left_out.push_back(absl::StrCat(count, " ", what));
  }

  void Finish(const XmlNode& node) {
    const int64_t dropped =
        DropUnorientedObservations(block_, &block_.points) + DropUnorientedObservations(block_, &block_.control_points);
    LeaveOut(dropped, "measurements in photographs without a pose");
    LeaveOut(unknown_photos_, "measurements in photographs that the file does not list");
    LeaveOut(metadata_, "positions or rotations of GPS and IMU (Pose/Metadata)");
    LeaveOut(masks_, "masks of photographs");
    if (node.Child("PositioningConstraints").Child()) block_.left_out.push_back("the positioning constraints");
    if (inaccurate_ > 0) {
      warnings_.push_back(absl::StrCat(name_, ": the rotations of ", inaccurate_,
                                       " photographs are marked as not accurate; export after aerotriangulation"));
    }
    block_.conventions = {
        "the rotation goes from the world to the camera, in the axes of CameraOrientation; Center is the position",
        "positions in photographs count from the centre of the first pixel; half a pixel is added",
        "the focal length in x is FocalLength max(width, height) / SensorSize or FocalLengthPixels, in y it is times "
        "AspectRatio",
        "the distortion is Brown's with K1 to K3, from ideal to distorted positions"};
    if (HasTangential(block_)) {
      block_.conventions.push_back("P1 belongs to r^2 + 2 x^2 and P2 to r^2 + 2 y^2");
      block_.readings.push_back(ExchangedTangentialReading());
    }
    const auto has_aspect = [](const ExchangeCamera& camera) { return camera.aspect_ratio != 1; };
    if (std::any_of(cameras_.begin(), cameras_.end(), has_aspect)) {
      block_.readings.push_back({"AspectRatio divides the focal length in y", [](ImportedBlock* block) {
                                   for (BlockCamera& camera : block->cameras) {
                                     PinholeCamera& pinhole = camera.lens.pinhole;
                                     pinhole.fy = pinhole.fx * (pinhole.fx / pinhole.fy);
                                   }
                                 }});
    }
  }

  const std::string& name_;
  const ExchangeLoader& load_;
  const BlockReadOptions& options_;
  ImportedBlock& block_;
  Faults* faults_;
  Warnings& warnings_;
  std::string base_path_;
  std::unordered_map<int64_t, std::string> systems_;
  std::vector<ExchangeCamera> cameras_;         // as block_.cameras
  std::unordered_map<int64_t, size_t> images_;  // by Id
  std::map<std::string, int> images_in_;        // oriented images by system
  int64_t unknown_photos_ = 0, metadata_ = 0, masks_ = 0, inaccurate_ = 0;
  int64_t other_tie_points_ = 0;
};

// The member of the archive that is XML with one of the two roots; empty if there is none.
std::string ExchangeMember(ZipFile* archive, std::string_view root, std::string_view other_root) {
  for (const std::string& member : archive->members()) {
    const std::string name = XmlRootName(archive->ReadHead(member, kExchangeHeadBytes));
    if (name == root || name == other_root) return member;
  }
  return "";
}

// The XML at `path`, also in a zip archive, with one of the two roots.
StatusOr<std::string> LoadExchange(const std::string& path, std::string_view root, std::string_view other_root) {
  TESSERA_ASSIGN_OR_RETURN(const std::string head, ReadFileRange(path, 0, 4));
  if (!IsZip(head)) {
    if (!head.starts_with("\x1f\x8b")) return ReadFile(path, kMaxXmlBytes);
    return InputError(path, "", "a file of gzip", "XML, or a zip archive with it; decompress it with gunzip");
  }
  TESSERA_ASSIGN_OR_RETURN(ZipFile archive, ZipFile::Open(path));
  const std::string member = ExchangeMember(&archive, root, other_root);
  if (!member.empty()) return archive.Read(member, kMaxXmlBytes);
  return InputError(path, "", absl::StrCat("an archive without a file of ", std::string(root)), "one");
}

}  // namespace

bool IsBlocksExchange(const std::string& path) {
  const StatusOr<std::string> head = ReadFileRange(path, 0, kExchangeHeadBytes);
  if (!head.ok()) return false;
  if (!IsZip(*head)) return XmlRootName(*head) == kExchangeRoot;
  StatusOr<ZipFile> archive = ZipFile::Open(path);
  return archive.ok() && !ExchangeMember(&*archive, kExchangeRoot, kExchangeRoot).empty();
}

ImportedBlock ReadBlocksExchange(const std::string& path, const BlockReadOptions& options, Faults* faults,
                                 Warnings* warnings) {
  std::vector<std::string> files = {AbsolutePath(path)};
  // As the XML has it, or the file of that name beside the block, or in its archive.
  const ExchangeLoader load = [&](const std::string& other) -> StatusOr<std::string> {
    const std::string base = other.substr(other.find_last_of("/\\") + 1);
    const std::filesystem::path folder = std::filesystem::path(path).parent_path();
    for (const std::filesystem::path& candidate : {folder / other, folder / base}) {
      if (!std::filesystem::is_regular_file(candidate)) continue;
      files.push_back(AbsolutePath(candidate));
      return LoadExchange(candidate, "TiePoint", "TiePoints");
    }
    if (StatusOr<std::string> head = ReadFileRange(path, 0, 4); head.ok() && IsZip(*head)) {
      TESSERA_ASSIGN_OR_RETURN(ZipFile archive, ZipFile::Open(path));
      for (const std::string& member : archive.members()) {
        if (member.substr(member.find_last_of('/') + 1) == base) return archive.Read(member, kMaxXmlBytes);
      }
    }
    return absl::NotFoundError(other);
  };
  StatusOr<std::string> text = LoadExchange(path, kExchangeRoot, kExchangeRoot);
  if (!text.ok()) {
    faults->Add(text.status());
    return {};
  }
  ImportedBlock block = ParseBlocksExchange(*std::move(text), path, load, options, faults, warnings);
  block.files = files;
  return block;
}

ImportedBlock ParseBlocksExchange(std::string text, const std::string& name, const ExchangeLoader& load,
                                  const BlockReadOptions& options, Faults* faults, Warnings* warnings) {
  ImportedBlock block;
  const StatusOr<XmlFile> file = XmlFile::Parse(std::move(text), name);
  if (!file.ok()) {
    faults->Add(file.status());
    return block;
  }
  ExchangeReader(name, load, options, &block, faults, warnings).Read(file->Root());
  return block;
}

}  // namespace tessera
