#include "common/synth/city/base_city.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/storage/files.h"

namespace tessera {
namespace {

// The number of lines of `text` that are not comments.
int64_t CountLines(const std::string& text) {
  int64_t lines = 0;
  for (size_t at = 0; at < text.size(); at = std::min(text.find('\n', at), text.size() - 1) + 1) {
    lines += text[at] != '#';
  }
  return lines;
}

}  // namespace

StatusOr<BaseCity> ReadBaseCity(const std::string& folder) {
  const std::string file = folder + "/synth.json";
  if (!FileExists(file)) return InputError(file, "", "no such file", "the folder of a city made by tessera synth");
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file, 1 << 20));
  BaseCity base;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    if (json.contains("change")) return InputError(file, "change", "a second epoch", "the first epoch of a city");
    const nlohmann::json& parameters = json.at("parameters");
    base.options.columns = parameters.at("blocks").at(0).get<int>();
    base.options.rows = parameters.at("blocks").at(1).get<int>();
    base.options.seed = parameters.at("seed").get<uint64_t>();
    base.options.gsd_m = parameters.at("gsd_m").get<double>();
    base.options.image_width_px = parameters.at("image_size_px").at(0).get<int>();
    base.options.image_height_px = parameters.at("image_size_px").at(1).get<int>();
    if (!parameters.at("images").get<bool>()) return InputError(file, "images", "false", "a city with images");
    base.report.start_faces = json.at("made").at("start_faces").get<int64_t>();
    const nlohmann::json& difficulty = json.at("difficulty");
    base.report.start_accuracy_by_area = difficulty.at("start_average_accuracy_by_area").get<double>();
    base.report.start_accuracy_by_pixels = difficulty.at("start_average_accuracy_by_pixels").get<double>();
  } catch (const nlohmann::json::exception& error) {
    return InputError(file, "", error.what(), "a synth.json written by tessera synth");
  }
  return base;
}

Status LinkFile(const std::string& from, const std::string& to) {
  std::error_code error;
  std::filesystem::create_hard_link(from, to, error);
  return error ? CopyFileDurably(from, to) : absl::OkStatus();
}

Status LinkFiles(const std::string& from, const std::string& to) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListFiles(from));
  for (const std::string& name : names) {
    const std::filesystem::path target = to + "/" + name;
    TESSERA_RETURN_IF_ERROR(EnsureFolder(target.parent_path().string()));
    TESSERA_RETURN_IF_ERROR(LinkFile(from + "/" + name, target.string()));
  }
  return absl::OkStatus();
}

StatusOr<ColmapText> ReadColmapText(const std::string& folder) {
  ColmapText model;
  TESSERA_ASSIGN_OR_RETURN(model.cameras, ReadFile(folder + "/cameras.txt"));
  TESSERA_ASSIGN_OR_RETURN(model.images, ReadFile(folder + "/images.txt"));
  TESSERA_ASSIGN_OR_RETURN(model.points, ReadFile(folder + "/points3D.txt"));
  model.image_count = static_cast<int>(CountLines(model.images) / 2);
  model.point_count = CountLines(model.points);
  return model;
}

}  // namespace tessera
