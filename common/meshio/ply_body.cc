#include "common/meshio/ply_body.h"

#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

constexpr int64_t kMaxTrailingBytes = 16;

}  // namespace

Status CheckPlyEnd(ByteSource& source, const std::string& name, const std::string& place,
                   const MeshReadOptions& options) {
  const bool at_end = source.AtEnd();
  TESSERA_RETURN_IF_ERROR(source.status());
  if (at_end) return absl::OkStatus();
  const int64_t left = source.size_bytes() - source.offset_bytes();
  if (left > kMaxTrailingBytes) {
    return InputError(name, place, absl::StrCat(left, " bytes after the last element"), "the end of the file");
  }
  options.Warn(absl::StrCat(left, left == 1 ? " byte" : " bytes", " after the last element ignored (", place, ")"));
  return absl::OkStatus();
}

bool LabelOf(int64_t value, int32_t& label) {
  if (value < -1 || value > std::numeric_limits<int32_t>::max()) return false;
  label = static_cast<int32_t>(value);
  return true;
}

bool LabelOf(double value, int32_t& label) {
  // NaN is unequal to itself.
  if (value != std::floor(value) || value < -1 || value > std::numeric_limits<int32_t>::max()) return false;
  label = static_cast<int32_t>(value);
  return true;
}

std::string ExpectedLabel(const PlyHeader& header) {
  // A property of another name may hold something else.
  return absl::StrCat("a class index (a whole number), or -1 for no label",
                      header.label_property == "label"
                          ? ""
                          : absl::StrCat("; if ", Quoted(header.label_property),
                                         " holds no labels, set \"label_property\": null in scene.json"));
}

}  // namespace tessera
