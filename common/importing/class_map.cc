#include "common/importing/class_map.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/base/printable.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr int64_t kMaxClassMapBytes = 4 << 20;
constexpr char kClassMapExample[] = "a JSON object such as {\"Roof_01\": \"roof\", \"Trees\": null}";

}  // namespace

StatusOr<ClassMap> ParseClassMap(const std::string& text, const std::string& name) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(name, text));
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    return InputError(name, absl::StrCat("byte ", error.byte), "damaged JSON", kClassMapExample);
  } catch (const nlohmann::json::exception&) {  // a number out of range
    return InputError(name, "", "damaged JSON", kClassMapExample);
  }
  if (!json.is_object()) return InputError(name, "", "no object", kClassMapExample);
  ClassMap classes;
  Faults faults;
  for (const auto& [key, value] : json.items()) {
    if (!value.is_null() && (!value.is_string() || value == "")) {
      faults.Add(InputError(name, absl::StrCat("key ", JsonQuoted(key)), "a value that is no name",
                            "the name of a class in quotes, or null"));
      continue;
    }
    classes[key] = value.is_null() ? "" : value.get<std::string>();
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return classes;
}

StatusOr<ClassMap> ReadClassMap(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxClassMapBytes));
  return ParseClassMap(text, path);
}

}  // namespace tessera
