#include "common/exporting/obj/obj_materials.h"

#include <array>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

constexpr size_t kMaxObjMaterialBytes = 200;

std::string ObjMaterialNameOf(const std::string& name) {
  std::string material = name.substr(0, kMaxObjMaterialBytes);
  for (char& c : material) {
    const bool kept = absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_' ||
                      static_cast<unsigned char>(c) >= 0x80;
    if (!kept) c = '_';
  }
  return material.empty() ? "class" : material;
}

}  // namespace

std::vector<std::string> ObjMaterialNames(std::span<const SceneClass> classes) {
  std::vector<std::string> names;
  std::set<std::string> used;
  const auto add = [&](const std::string& name) {
    std::string unique = name;
    for (int number = 2; !used.insert(unique).second; ++number) unique = absl::StrCat(name, "_", number);
    names.push_back(unique);
  };
  for (const SceneClass& c : classes) add(ObjMaterialNameOf(c.name));
  add("unclassified");
  return names;
}

std::string ObjMaterials(std::span<const SceneClass> classes) {
  const std::vector<std::string> names = ObjMaterialNames(classes);
  std::string text;
  for (size_t k = 0; k < names.size(); ++k) {
    const std::array<uint8_t, 3> rgb = k < classes.size() ? classes[k].color_rgb : std::array<uint8_t, 3>{0, 0, 0};
    absl::StrAppendFormat(&text, "newmtl %s\nKd %.6f %.6f %.6f\nillum 1\n", names[k], rgb[0] / 255.0, rgb[1] / 255.0,
                          rgb[2] / 255.0);
  }
  return text;
}

std::string ObjClassMap(std::span<const SceneClass> classes) {
  const std::vector<std::string> names = ObjMaterialNames(classes);
  nlohmann::ordered_json map = nlohmann::ordered_json::object();
  for (size_t k = 0; k < classes.size(); ++k) map[names[k]] = classes[k].name;
  map[names.back()] = nullptr;
  return map.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace tessera
