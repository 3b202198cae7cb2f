#include "common/blocks/metashape/metashape_crs.h"

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

// The first node "KEYWORD[...]" of `wkt`; empty if there is none or it does not end.
std::string_view WktNode(std::string_view wkt, std::string_view keyword) {
  size_t begin = std::string_view::npos;
  int depth = 0;
  bool quoted = false;
  for (size_t at = 0; at < wkt.size(); ++at) {
    if (wkt[at] == '"') quoted = !quoted;
    if (quoted) continue;
    const std::string_view rest = wkt.substr(at);
    const bool follows = at == 0 || wkt[at - 1] == ',' || wkt[at - 1] == '[' || wkt[at - 1] == ' ';
    if (begin == std::string_view::npos && follows && rest.starts_with(keyword) &&
        rest.substr(keyword.size()).starts_with("[")) {
      begin = at;
      depth = 0;
    }
    if (wkt[at] == '[') ++depth;
    if (wkt[at] == ']' && --depth == 0 && begin != std::string_view::npos) return wkt.substr(begin, at - begin + 1);
  }
  return {};
}

}  // namespace

std::string GeocentricOf(std::string_view wkt) {
  if (wkt.starts_with("GEOCCS[")) return std::string(wkt);
  const std::string_view geographic = WktNode(wkt, "GEOGCS");
  if (geographic.ends_with("AUTHORITY[\"EPSG\",\"4326\"]]")) return "EPSG:4978";
  if (geographic.ends_with("AUTHORITY[\"EPSG\",\"4258\"]]")) return "EPSG:4936";
  const std::string datum(WktNode(geographic, "DATUM"));
  std::string meridian(WktNode(geographic, "PRIMEM"));
  if (datum.empty()) return "";
  if (meridian.empty()) meridian = "PRIMEM[\"Greenwich\",0]";
  return absl::StrCat("GEOCCS[\"earth-centred\",", datum, ",", meridian, ",UNIT[\"metre\",1]]");
}

}  // namespace tessera
