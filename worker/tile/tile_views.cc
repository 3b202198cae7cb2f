#include "worker/tile/tile_views.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/arrays/mapped_arrays.h"
#include "common/base/parallel.h"
#include "common/imaging/image_io.h"
#include "common/scene/photographs.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "worker/photo/texels.h"
#include "worker/tile/kept/kept_files.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr size_t kMostOpenCrops = 64;               // files, of tiles; little memory each
constexpr uint64_t kPartBytes = uint64_t{1} << 18;  // that are copied at once; stay in the cache
constexpr size_t kCropsOfLane = 4;                  // between reports of progress

// Metadata of a view in the file: the shape of level 0.
struct Crop {
  int32_t view = 0;  // index in the survey
  TexelShape shape;
};

std::string LuminanceName(size_t crop, int level) { return absl::StrFormat("%06d.%d.luminance", crop, level); }
std::string LikelihoodName(size_t crop, int level) { return absl::StrFormat("%06d.%d.likelihoods", crop, level); }

// Shapes of all levels.
std::vector<TexelShape> LevelsOf(const TexelShape& first) {
  std::vector<TexelShape> levels = {first};
  while (static_cast<int>(levels.size()) < kTexelLevels) levels.push_back(levels.back().Half());
  return levels;
}

// The level whose likelihoods `level` uses.
int LikelihoodLevel(const TexelShape& first, int level) { return first.same_resolution ? level : 0; }

ImagePart PartOf(const PixelRect& rect) { return {rect.x0, rect.y0, rect.x1, rect.y1}; }

int ClassesOf(const ViewWindows& windows, const SceneView& view) {
  return view.likelihood_path.empty() ? 0 : windows.classes;
}

// The shape of level 0, from the headers of the view's files.
StatusOr<TexelShape> ShapeOf(const ViewWindows::Window& window, int classes, const std::string& folder) {
  const SceneView& view = window.view;
  TexelShape shape;
  shape.rect = window.rect;
  if (classes == 0) return shape;
  TESSERA_ASSIGN_OR_RETURN(const LikelihoodExtent extent,
                           ReadLikelihoodExtent(folder + "/" + view.likelihood_path, classes, view.lens,
                                                PartOf(shape.rect), view.likelihood_form));
  const PinholeCamera& whole = view.camera.intrinsics;
  PixelMapping mapping;
  mapping.scale_x = static_cast<double>(extent.whole_width) / whole.width;
  mapping.scale_y = static_cast<double>(extent.whole_height) / whole.height;
  mapping.first_x = extent.part.x0;
  mapping.first_y = extent.part.y0;
  return TexelShape::First(shape.rect, classes, extent.part.width(), extent.part.height(), mapping);
}

// All levels; `likelihoods` only of those that have their own.
struct LoadedCrop {
  std::array<std::vector<uint16_t>, kTexelLevels> luminance;
  std::array<std::vector<uint8_t>, kTexelLevels> likelihoods;
};

StatusOr<LoadedCrop> ReadCrop(const SceneView& view, const std::string& folder, const TexelShape& shape) {
  LoadedCrop crop;
  {
    TESSERA_ASSIGN_OR_RETURN(const FloatImage image, ReadLuminancePart(folder + "/" + view.image_path, view.lens,
                                                                       PartOf(shape.rect), OptionsOf(folder, view)));
    crop.luminance[0] = LuminanceCodes(image.data);
  }
  if (shape.classes > 0) {
    const std::string path = folder + "/" + view.likelihood_path;
    TESSERA_ASSIGN_OR_RETURN(const LikelihoodPart part, ReadLikelihoodPart(path, shape.classes, view.lens,
                                                                           PartOf(shape.rect), view.likelihood_form));
    crop.likelihoods[0] = LikelihoodStepsOf(part.pixels.data);
    if (crop.likelihoods[0].size() != shape.likelihood_values()) {
      return absl::UnavailableError(path + ": changed while it was read");
    }
  }
  StoredTexels level;
  static_cast<TexelShape&>(level) = shape;
  for (int l = 0; l + 1 < kTexelLevels; ++l) {
    level.luminance = crop.luminance[l];
    level.likelihoods = crop.likelihoods[l];
    crop.luminance[l + 1] = level.HalfLuminance();
    if (level.same_resolution) crop.likelihoods[l + 1] = level.HalfLikelihoods();
    static_cast<TexelShape&>(level) = level.Half();
  }
  return crop;
}

// Bound on the memory of ReadCrop, not below that of PredictCrop (server/tiling): floats of the crop's planes before
// and after undistortion, and the decoded files.
double BytesToRead(const ViewWindows::Window& window, int classes) {
  const PinholeCamera& whole = window.view.camera.intrinsics;
  const double planes = 1 + classes;
  return 8 * planes * window.rect.width() * window.rect.height() + 4 * planes * whole.width * whole.height;
}

json ToJson(const Crop& crop) {
  const TexelShape& s = crop.shape;
  return {{"view", crop.view},
          {"rect", {s.rect.x0, s.rect.y0, s.rect.x1, s.rect.y1}},
          {"likelihoods", {s.likelihood_width, s.likelihood_height, s.classes}},
          {"mapping", {s.mapping.scale_x, s.mapping.scale_y, s.mapping.first_x, s.mapping.first_y}}};
}

Crop ParseCrop(const json& j) {
  const json &rect = j.at("rect"), &likelihoods = j.at("likelihoods"), &m = j.at("mapping");
  PixelMapping mapping;
  mapping.scale_x = m.at(0);
  mapping.scale_y = m.at(1);
  mapping.first_x = m.at(2);
  mapping.first_y = m.at(3);
  return {j.at("view"), TexelShape::First({rect.at(0), rect.at(1), rect.at(2), rect.at(3)}, likelihoods.at(2),
                                          likelihoods.at(0), likelihoods.at(1), mapping)};
}

// Writes crops in any order, on several threads.
class CropWriter {
 public:
  static StatusOr<CropWriter> Create(const std::string& path, const std::vector<int>& tiles,
                                     const std::vector<Crop>& crops) {
    json metadata = {{"tiles", tiles}, {"crops", json::array()}};
    std::vector<ArrayFileWriter::Array> arrays;
    for (size_t i = 0; i < crops.size(); ++i) {
      metadata["crops"].push_back(ToJson(crops[i]));
      const std::vector<TexelShape> levels = LevelsOf(crops[i].shape);
      for (int l = 0; l < kTexelLevels; ++l) {
        arrays.push_back({LuminanceName(i, l), std::vector<uint16_t>(), levels[l].pixels()});
        if (levels[l].likelihood_values() == 0 || LikelihoodLevel(crops[i].shape, l) != l) continue;
        arrays.push_back({LikelihoodName(i, l), std::vector<uint8_t>(), levels[l].likelihood_values()});
      }
    }
    TESSERA_ASSIGN_OR_RETURN(auto file, ArrayFileWriter::Create(path, metadata.dump(), std::move(arrays)));
    return CropWriter(std::move(file));
  }

  void Add(size_t crop, const LoadedCrop& loaded) {
    for (int l = 0; l < kTexelLevels; ++l) {
      file_->Append(LuminanceName(crop, l), std::span<const uint16_t>(loaded.luminance[l]));
      if (loaded.likelihoods[l].empty()) continue;
      file_->Append(LikelihoodName(crop, l), std::span<const uint8_t>(loaded.likelihoods[l]));
    }
  }

  Status Finish() { return file_->Finish(); }

 private:
  explicit CropWriter(std::unique_ptr<ArrayFileWriter> file) : file_(std::move(file)) {}
  std::unique_ptr<ArrayFileWriter> file_;
};

// A file of crops: mapped, to check and release its arrays, and open, to copy parts of them. Const members are
// thread-safe.
class CropsFile {
 public:
  static StatusOr<std::shared_ptr<const CropsFile>> Open(const std::string& path) {
    TESSERA_ASSIGN_OR_RETURN(MappedArrays arrays, MappedArrays::Open(path));
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return FileError(errno, absl::StrCat("cannot open ", path));
    return std::shared_ptr<const CropsFile>(new CropsFile(std::move(arrays), fd));
  }
  CropsFile(const CropsFile&) = delete;
  CropsFile& operator=(const CropsFile&) = delete;
  ~CropsFile() { close(fd_); }

  const MappedArrays& arrays() const { return arrays_; }
  // Whether the file is in no folder any more.
  bool IsRemoved() const {
    struct stat file = {};
    return fstat(fd_, &file) != 0 || file.st_nlink == 0;
  }
  // Compares the array's bytes with their checksum at the first call, without mapping pages. Errors as
  // MappedArrays::Verify.
  Status Verify(const std::string& name) const {
    {
      const std::lock_guard lock(mutex_);
      if (verified_.contains(name)) return absl::OkStatus();
    }
    const auto found = entries_.find(name);
    if (found == entries_.end()) return arrays_.Verify(name);
    const uint64_t size_bytes = found->second->count * ArrayFileHeader::value_bytes(*found->second);
    Xxh3Hasher hasher;
    std::vector<char> part(std::min<uint64_t>(size_bytes, kPartBytes));
    for (uint64_t at = 0; at < size_bytes; at += part.size()) {
      part.resize(std::min<uint64_t>(part.size(), size_bytes - at));
      if (!Read(found->second->offset + at, part.size(), part.data())) return arrays_.Verify(name);
      hasher.Update(part.data(), part.size());
    }
    if (hasher.Digest() != found->second->hash) return arrays_.Verify(name);
    const std::lock_guard lock(mutex_);
    verified_.insert(name);
    return absl::OkStatus();
  }
  // Copies the bytes at `from` in `values`, which are those of the array `name`, without mapping pages. False if
  // `from` is not in them, or the file cannot be read.
  template <class T>
  bool Copy(const std::string& name, std::span<const T> values, const void* from, size_t size_bytes, void* to) const {
    const auto *begin = reinterpret_cast<const char*>(values.data()), *at = static_cast<const char*>(from);
    if (std::less<>()(at, begin) || std::less<>()(begin + values.size_bytes(), at + size_bytes)) return false;
    return Read(entries_.at(name)->offset + static_cast<uint64_t>(at - begin), size_bytes, to);
  }

 private:
  CropsFile(MappedArrays arrays, int fd) : arrays_(std::move(arrays)), fd_(fd) {
    for (const ArrayFileHeader::Entry& entry : arrays_.entries()) entries_[entry.name] = &entry;
  }

  bool Read(uint64_t offset, size_t size_bytes, void* to) const {
    for (size_t done = 0; done < size_bytes;) {
      const ssize_t got =
          pread(fd_, static_cast<char*>(to) + done, size_bytes - done, static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return false;
      done += static_cast<size_t>(got);
    }
    return true;
  }

  const MappedArrays arrays_;
  std::map<std::string, const ArrayFileHeader::Entry*> entries_;  // by name
  const int fd_;
  mutable std::mutex mutex_;
  mutable std::set<std::string> verified_;  // guarded by mutex_
};

// The crops at `path`. The last ones stay open, so that their checksums are compared once in a process, whether the
// tile's workspace stays in memory or not.
StatusOr<std::shared_ptr<const CropsFile>> OpenCrops(const std::string& path) {
  using Kept = std::list<std::pair<std::string, std::shared_ptr<const CropsFile>>>;
  static auto* const mutex = new std::mutex;
  static auto* const kept = new Kept;  // most recently used first
  TESSERA_ASSIGN_OR_RETURN(const std::string content, ContentKey(path));
  const std::lock_guard lock(*mutex);
  kept->remove_if([](const auto& entry) { return entry.second->IsRemoved(); });  // for their space on disk
  const auto found =
      std::find_if(kept->begin(), kept->end(), [&](const auto& entry) { return entry.first == content; });
  if (found != kept->end()) {
    kept->splice(kept->begin(), *kept, found);
    return kept->front().second;
  }
  TESSERA_ASSIGN_OR_RETURN(const std::shared_ptr<const CropsFile> file, CropsFile::Open(path));
  kept->emplace_front(content, file);
  if (kept->size() > kMostOpenCrops) kept->pop_back();
  return file;
}

// A window of one crop of a shared file.
class FilePixels : public ViewPixels {
 public:
  FilePixels(std::shared_ptr<const CropsFile> file, size_t index, const TexelShape& first, const PixelRect& window)
      : file_(std::move(file)), index_(index), levels_(LevelsOf(first)), window_(window) {}
  const PixelRect& rect() const override { return window_; }
  bool has_likelihoods() const override { return levels_.front().classes > 0; }
  StatusOr<StoredTexels> Level(int level) const override {
    StoredTexels out;
    static_cast<TexelShape&>(out) = levels_.at(level);
    const CropsFile* const file = file_.get();
    const std::string luminance = LuminanceName(index_, level);
    TESSERA_RETURN_IF_ERROR(file->Verify(luminance));
    TESSERA_ASSIGN_OR_RETURN(out.luminance,
                             file->arrays().Get<uint16_t>(luminance, static_cast<int64_t>(out.pixels())));
    std::string likelihoods;
    if (has_likelihoods()) {
      likelihoods = LikelihoodName(index_, LikelihoodLevel(levels_.front(), level));
      TESSERA_RETURN_IF_ERROR(file->Verify(likelihoods));
      TESSERA_ASSIGN_OR_RETURN(out.likelihoods,
                               file->arrays().Get<uint8_t>(likelihoods, static_cast<int64_t>(out.likelihood_values())));
    }
    out.release = [file, luminance, likelihoods] {
      file->arrays().Release(luminance);
      if (!likelihoods.empty()) file->arrays().Release(likelihoods);
    };
    out.copy = [file, luminance, likelihoods, of_luminance = out.luminance, of_likelihoods = out.likelihoods](
                   const void* from, size_t size_bytes, void* to) {
      return file->Copy(luminance, of_luminance, from, size_bytes, to) ||
             (!likelihoods.empty() && file->Copy(likelihoods, of_likelihoods, from, size_bytes, to));
    };
    return out;
  }

 private:
  std::shared_ptr<const CropsFile> file_;
  size_t index_;
  std::vector<TexelShape> levels_;
  PixelRect window_;
};

// The crops of a file that has those of `tile`.
struct CropsOfFile {
  std::shared_ptr<const CropsFile> file;
  std::vector<Crop> crops;

  // The crop that contains the window; null if there is none.
  const Crop* Find(int32_t view, const PixelRect& window) const {
    const auto found = std::find_if(crops.begin(), crops.end(), [&](const Crop& crop) {
      return crop.view == view && crop.shape.rect.Contains(window);
    });
    return found == crops.end() ? nullptr : &*found;
  }
};

StatusOr<CropsOfFile> ReadCropsOf(int tile, const std::string& path) {
  CropsOfFile out;
  TESSERA_ASSIGN_OR_RETURN(out.file, OpenCrops(path));
  try {
    const json metadata = json::parse(out.file->arrays().metadata());
    const std::vector<int> tiles = metadata.at("tiles");
    if (!std::binary_search(tiles.begin(), tiles.end(), tile)) {
      return absl::DataLossError(
          absl::StrCat(path, ": found crops of tiles ", absl::StrJoin(tiles, ", "), ", expected those of tile ", tile));
    }
    for (const json& crop : metadata.at("crops")) out.crops.push_back(ParseCrop(crop));
  } catch (const json::exception& e) {
    return absl::DataLossError(path + ": found invalid metadata, expected that of crops: " + e.what());
  }
  return out;
}

}  // namespace

Status AddWindows(const TilePackage& package, const std::string& earlier, ViewWindows* windows) {
  CropsOfFile cropped;
  if (!earlier.empty()) {
    TESSERA_ASSIGN_OR_RETURN(cropped, ReadCropsOf(package.tile, earlier));
  }
  windows->tiles.push_back(package.tile);
  if (package.has_likelihoods) windows->classes = static_cast<int>(package.classes.size());
  for (size_t v = 0; v < package.views.size(); ++v) {
    const PixelRect& rect = package.view_rects[v];
    if (rect.empty() || cropped.Find(package.view_ids[v], rect) != nullptr) continue;
    PixelRect all = rect;
    auto [each, last] = windows->of_view.equal_range(package.view_ids[v]);
    while (each != last) {
      const PixelRect both = all.With(each->second.rect);
      if (both.area() > all.area() + each->second.rect.area()) {  // far apart
        ++each;
        continue;
      }
      all = both;
      each = windows->of_view.erase(each);
    }
    windows->of_view.insert({package.view_ids[v], {package.views[v], all}});
  }
  return absl::OkStatus();
}

Status CropViews(const ViewWindows& windows, const std::string& folder, const std::string& path,
                 const TaskControl& control) {
  std::vector<const ViewWindows::Window*> shown;
  std::vector<Crop> crops;
  double largest_bytes = 0;
  for (const auto& [id, window] : windows.of_view) {
    shown.push_back(&window);
    crops.push_back({id, {}});
    largest_bytes = std::max(largest_bytes, BytesToRead(window, ClassesOf(windows, window.view)));
  }
  // The file begins with the sizes of all crops.
  std::vector<Status> found(shown.size());
  ParallelForEach(shown.size(), 1, [&](size_t i) {
    StatusOr<TexelShape> shape = ShapeOf(*shown[i], ClassesOf(windows, shown[i]->view), folder);
    found[i] = shape.status();
    if (shape.ok()) crops[i].shape = *shape;
  });
  for (const Status& status : found) TESSERA_RETURN_IF_ERROR(status);
  TESSERA_ASSIGN_OR_RETURN(CropWriter writer, CropWriter::Create(path, windows.tiles, crops));
  // Each lane reads and writes one crop after the other, so at_once are in memory.
  const auto at_once = static_cast<size_t>(ItemsAtOnce(largest_bytes)), part = kCropsOfLane * at_once;
  for (size_t first = 0; first < shown.size(); first += part) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.9 * static_cast<double>(first) / static_cast<double>(shown.size()), "reading images");
    const size_t end = std::min(first + part, shown.size());
    std::vector<Status> read(end - first);
    ParallelForEach(at_once, 1, [&](size_t lane) {
      for (size_t i = first + lane; i < end; i += at_once) {
        const StatusOr<LoadedCrop> loaded = ReadCrop(shown[i]->view, folder, crops[i].shape);
        read[i - first] = loaded.status();
        if (!loaded.ok()) break;
        writer.Add(i, *loaded);
      }
    });
    for (const Status& status : read) TESSERA_RETURN_IF_ERROR(status);
  }
  control.Report(0.9, "writing crops");
  return writer.Finish();
}

StatusOr<std::vector<RefineView>> OpenTileViews(const TilePackage& package, const std::vector<std::string>& paths) {
  std::vector<CropsOfFile> files;
  for (const std::string& path : paths) {
    TESSERA_ASSIGN_OR_RETURN(files.emplace_back(), ReadCropsOf(package.tile, path));
  }
  std::vector<RefineView> views;
  for (size_t v = 0; v < package.views.size(); ++v) {
    const PixelRect& window = package.view_rects[v];
    if (window.empty()) continue;
    std::shared_ptr<const ViewPixels> pixels;
    for (const CropsOfFile& file : files) {
      const Crop* const crop = pixels == nullptr ? file.Find(package.view_ids[v], window) : nullptr;
      if (crop != nullptr) {
        pixels = std::make_shared<FilePixels>(file.file, crop - file.crops.data(), crop->shape, window);
      }
    }
    if (pixels == nullptr) {
      return absl::DataLossError(absl::StrCat(absl::StrJoin(paths, ", "), ": found no crop of view ",
                                              package.view_ids[v], " with the pixels that tile ", package.tile,
                                              " needs"));
    }
    const auto& [near_m, far_m] = package.view_depths[v];
    views.push_back({package.views[v].camera,
                     std::move(pixels),
                     {static_cast<float>(near_m), static_cast<float>(far_m)},
                     package.view_ids[v],
                     static_cast<int>(v)});
  }
  return views;
}

std::vector<ViewPair> PairsOf(const TilePackage& package, const std::vector<RefineView>& views) {
  std::vector<int> loaded(package.views.size(), -1);
  for (size_t v = 0; v < views.size(); ++v) loaded[views[v].index] = static_cast<int>(v);
  std::vector<ViewPair> pairs;
  for (const auto& [reference, other] : package.pairs) {
    if (loaded[reference] >= 0 && loaded[other] >= 0) pairs.push_back({loaded[reference], loaded[other]});
  }
  return pairs;
}

ViewGroups GroupsOf(const TilePackage& package, const std::vector<RefineView>& views) {
  ViewGroups groups;
  std::vector<uint8_t> of_cell(package.views.size(), 0);
  for (size_t c = 0; c < package.cell_at.size(); ++c) {
    groups.group_of_face.resize(package.cells.face_begin[c + 1], static_cast<uint32_t>(c));
    for (const int32_t view : package.cell_views[c]) of_cell[view] = 1;
    std::vector<uint8_t>& selected = groups.selected.emplace_back();
    selected.reserve(views.size());
    for (const RefineView& view : views) selected.push_back(of_cell[view.index]);
    for (const int32_t view : package.cell_views[c]) of_cell[view] = 0;
  }
  return groups;
}

}  // namespace tessera
