#include "common/blocks/opensfm/opensfm_files.h"

#include <algorithm>
#include <filesystem>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/blocks/opensfm/opensfm.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"
#include "common/storage/mapped_file.h"

namespace tessera {
namespace {

constexpr uint64_t kSfmMaxJsonBytes = uint64_t{2} << 30, kSfmMaxTracksBytes = uint64_t{64} << 30;
constexpr int64_t kSfmMaxSmallFileBytes = int64_t{256} << 20;
constexpr int kSfmMaxTrackFaults = 20;

bool HoldsSfmReconstructions(const std::string& file) {
  const StatusOr<std::string> head = ReadFileRange(file, 0, 256);
  if (!head.ok()) return false;
  std::string text = *head;
  std::erase_if(text, [](char c) { return IsBlank(c) || c == '\n'; });
  for (const char* key : {"cameras", "shots", "points", "reference_lla", "biases", "rig_cameras", "rig_instances"}) {
    if (text.starts_with(absl::StrCat("[{\"", key, "\":"))) return true;
  }
  return false;
}

// The reconstruction that is read of `path`, empty if there is none.
std::string FindSfmReconstruction(const std::string& path) {
  if (!std::filesystem::is_directory(path)) return path;
  for (const char* name : {"/opensfm/reconstruction.topocentric.json", "/opensfm/reconstruction.json",
                           "/reconstruction.topocentric.json", "/reconstruction.json"}) {
    if (FileExists(path + name)) return path + name;
  }
  return "";
}

}  // namespace

void ReadOpenSfmTracks(std::string_view tracks, const OpenSfmIndices& images, const OpenSfmIndices& points,
                       ImportedBlock* block, Faults* faults) {
  constexpr std::string_view kHeader = "OPENSFM_TRACKS_VERSION_v";
  std::string_view rest = tracks;
  int64_t line_number = 0, version = 0;
  size_t others = 0;
  int of_tracks = 0;
  const auto fault = [&](std::string_view found, const std::string& expected) {
    faults->Add(InputError("tracks.csv", absl::StrCat("line ", line_number), Quoted(found), expected));
    ++of_tracks;
  };
  std::string_view last_shot;
  auto shot = images.end();
  while (!rest.empty() && of_tracks < kSfmMaxTrackFaults) {
    const size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() && rest.empty()) break;
    if (++line_number == 1 && line.starts_with(kHeader)) {
      if (!ParseInteger(line.substr(kHeader.size()), version) || version < 0 || version > 2)
        return fault(line, "version 0, 1 or 2 of tracks");
      continue;
    }
    std::string_view words[5];
    const size_t columns = 1 + static_cast<size_t>(std::count(line.begin(), line.end(), '\t'));
    for (std::string_view& word : words) {
      word = line.substr(0, line.find('\t'));
      line.remove_prefix(std::min(word.size() + 1, line.size()));
    }
    const size_t expected = version == 0 ? 8 : version == 1 ? 9 : 11;
    Eigen::Vector2d x;
    if (columns != expected) {
      fault(words[0], absl::StrCat(expected, " columns, found ", columns));
      continue;
    }
    if (!ParseNumber(words[3], x.x()) || !ParseNumber(words[4], x.y()) || !(x.cwiseAbs().maxCoeff() <= 1)) {
      fault(absl::StrCat(std::string(words[3]), " ", std::string(words[4])), "normalised coordinates from -1 to 1");
      continue;
    }
    if (words[0] != last_shot) {
      last_shot = words[0];
      shot = images.find(last_shot);
    }
    const auto point = points.find(words[1]);
    if (shot == images.end() || point == points.end()) {
      ++others;
      continue;
    }
    const PinholeCamera& camera = block->cameras[block->images[shot->second].camera].lens.pinhole;
    std::vector<BlockObservation>& observations = block->points[point->second].observations;
    const auto same = [&](const BlockObservation& other) { return other.image == shot->second; };
    if (std::any_of(observations.begin(), observations.end(), same)) {
      fault(words[0], absl::StrCat("one observation of track ", Quoted(words[1]), " in this shot"));
      continue;
    }
    const Eigen::Vector2d middle(camera.width / 2.0, camera.height / 2.0);
    observations.push_back({shot->second, middle + std::max(camera.width, camera.height) * x});
  }
  if (of_tracks == kSfmMaxTrackFaults) fault("more faults", "a whole file; the rest was not read");
  if (others > 0) {
    block->left_out.push_back(
        absl::StrCat(others, " observations of tracks.csv: this reconstruction lacks their images or points"));
  }
}

std::optional<OpenDroneMapGrid> ReadOpenDroneMapGrid(const char* file, std::string_view text, Faults* faults) {
  if (text.empty()) return std::nullopt;
  const size_t end = std::min(text.find('\n'), text.size());
  std::string_view line = text.substr(0, end), second = text.substr(std::min(end + 1, text.size()));
  while (!line.empty() && (IsBlank(line.back()) || line.back() == '\n')) line.remove_suffix(1);
  second = second.substr(0, second.find('\n'));
  OpenDroneMapGrid grid;
  int64_t zone = 0;
  bool south = line.ends_with('S') || line.find("+south") != std::string_view::npos;
  if (line.starts_with("WGS84 UTM ")) {
    std::string_view word = line.substr(10);
    if (word.ends_with('N') || word.ends_with('S')) word.remove_suffix(1);
    if (!ParseInteger(word, zone)) zone = -1;
  } else if (line.starts_with("+proj=utm ") && line.find("+datum=WGS84") != std::string_view::npos) {
    const size_t at = line.find("+zone=");
    std::string_view word = at == std::string_view::npos ? "" : line.substr(at + 6);
    if (!ParseInteger(word.substr(0, word.find(' ')), zone)) zone = -1;
  } else if (line.starts_with("+proj") || line.starts_with("EPSG:") || line.starts_with("epsg:")) {
    grid.crs = line;
  } else {
    zone = -1;
  }
  if (zone < 0 || zone > 60 || (zone == 0 && grid.crs.empty())) {
    faults->Add(InputError(file, "line 1", Quoted(line), "a system such as WGS84 UTM 31N, +proj=... or EPSG:25832"));
    return std::nullopt;
  }
  if (zone > 0) grid.crs = absl::StrCat("EPSG:", (south ? 32700 : 32600) + zone);
  SkipBlanks(second);
  Eigen::Vector2d offset;
  if (ParseNumber(TakeWord(second), offset.x()) && ParseNumber(TakeWord(second), offset.y()) && offset.allFinite())
    grid.offset = offset;
  return grid;
}

bool IsOpenSfm(const std::string& path) {
  const std::string file = FindSfmReconstruction(path);
  if (file.empty()) return FileExists(path + "/odm_georeferencing") || FileExists(path + "/odm_report");
  return HoldsSfmReconstructions(file);
}

ImportedBlock ReadOpenSfm(const std::string& path, const BlockReadOptions& options, Faults* faults,
                          Warnings* warnings) {
  const std::string file = FindSfmReconstruction(AbsolutePath(path));
  if (file.empty()) {
    faults->Add(
        InputError(path, "", "no opensfm/reconstruction.json",
                   "the whole folder of the OpenDroneMap project, with its folder opensfm (downloads of results "
                   "lack it)"));
    return {};
  }
  const std::filesystem::path folder = std::filesystem::path(file).parent_path(), project = folder.parent_path();
  OpenSfmFiles files;
  files.path = file;
  files.topocentric = file.ends_with("/reconstruction.topocentric.json");
  files.projected = !files.topocentric && FileExists(folder / "reconstruction.topocentric.json");
  std::vector<std::string> read = {file};
  const auto map = [&](const std::string& name, uint64_t max_bytes) {
    StatusOr<MappedFile> mapped = MappedFile::Open(name);
    faults->Add(mapped.status());
    if (mapped.ok() && mapped->size_bytes() > max_bytes) {
      faults->Add(
          InputError(name, "", absl::StrCat(mapped->size_bytes(), " bytes"), absl::StrCat("at most ", max_bytes)));
    }
    return mapped.ok() ? *std::move(mapped) : MappedFile();
  };
  const MappedFile reconstructions = map(file, kSfmMaxJsonBytes);
  files.reconstructions = {reconstructions.data(), reconstructions.size_bytes()};
  MappedFile tracks;
  if (const std::string name = folder / "tracks.csv"; FileExists(name)) {
    tracks = map(name, kSfmMaxTracksBytes);
    files.tracks = {tracks.data(), tracks.size_bytes()};
    read.push_back(name);
  }
  const std::pair<std::filesystem::path, std::string_view*> small[] = {
      {folder / "reference_lla.json", &files.reference_lla},
      {project / "odm_report/shots.geojson", &files.shots},
      {project / "odm_georeferencing/coords.txt", &files.coords},
      {project / "odm_georeferencing/odm_georeferencing_model_geo.txt", &files.model_geo},
      {project / "odm_georeferencing/proj.txt", &files.proj}};
  std::string contents[std::size(small)];
  for (size_t i = 0; i < std::size(small); ++i) {
    if (!FileExists(small[i].first)) continue;
    StatusOr<std::string> content = ReadFile(small[i].first, kSfmMaxSmallFileBytes);
    faults->Add(content.status());
    if (!content.ok()) continue;
    contents[i] = *std::move(content);
    *small[i].second = contents[i];
    read.push_back(small[i].first);
  }
  if (!faults->empty()) return {};
  ImportedBlock block = ParseOpenSfm(files, options, faults, warnings);
  block.files = read;
  for (BlockImage& image : block.images) {
    for (const std::filesystem::path& parent : {project, folder}) {
      const std::string candidate = parent / "images" / image.path;
      if (!FileExists(candidate)) continue;
      image.path = candidate;
      break;
    }
  }
  return block;
}

}  // namespace tessera
