#include "server/display/update_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/job/task_parameters.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr double kBytesPerMiB = 1 << 20, kBytesPerGiB = 1 << 30, kSecondsPerHour = 3600;

template <class Make>
StatusOr<std::string> FromJson(const std::string& text, const Make& make) {
  try {
    return make(json::parse(text));
  } catch (const json::exception& e) {
    return absl::DataLossError(absl::StrCat(kUpdateFile, ": ", e.what()));
  }
}

// Redone for its own sake; from scratch others may be, too.
bool IsRedone(const json& tile) { return tile.at("redone") == true; }

// "update of jobs/1: ..."
std::string Sentence(const json& plan) {
  const int redone = plan.at("tiles_redone"), tiles = static_cast<int>(plan.at("tiles").size());
  const std::string base = plan.at("base");
  const size_t gone = plan.value("tiles_gone", json::array()).size();
  const std::string without = gone > 0 ? absl::StrCat(", ", gone, " gone, of which the mesh has nothing left") : "";
  if (plan.at("from_scratch").get<bool>()) {
    return absl::StrFormat(
        "update of %s from scratch: %d of %d tiles changed, the others follow as far as that reaches%s", base, redone,
        tiles, without);
  }
  return absl::StrFormat("update of %s: %d of %d tiles redone, %d kept as they are, to the byte%s", base, redone, tiles,
                         tiles - redone, without);
}

// "image seen: 4 images (new/0001.jpg, ...)".
std::string Reasons(const json& tile) {
  std::vector<std::string> reasons;
  for (const json& why : tile.at("why")) {
    const json& images = why.at("images");
    if (images.empty()) {
      reasons.push_back(why.at("reason"));
      continue;
    }
    reasons.push_back(absl::StrFormat("%s: %d (%s%s)", why.at("reason").get<std::string>(), images.size(),
                                      images.front().get<std::string>(), images.size() > 1 ? ", ..." : ""));
  }
  return absl::StrJoin(reasons, "; ");
}

double PredictedSeconds(const json& tile) { return tile.at("predicted").at("core_seconds").get<double>(); }

}  // namespace

StatusOr<std::string> UpdateTable(const std::string& text, const PlanTerms& terms) {
  return FromJson(text, [&](const json& plan) {
    std::string out = absl::StrFormat("%6s %12s %9s  %s\n", "tile", "core-seconds", "MiB", "why");
    for (const json& tile : plan.at("tiles")) {
      if (!IsRedone(tile)) continue;
      absl::StrAppendFormat(&out, "%6d %12.1f %9.0f  %s\n", tile.at("tile").get<int>(), PredictedSeconds(tile),
                            tile.at("predicted").at("peak_bytes").get<double>() / kBytesPerMiB, Reasons(tile));
    }
    const json& predicted = plan.at("predicted");
    const double seconds = predicted.at("core_seconds"), in_full = predicted.at("core_seconds_in_full");
    absl::StrAppend(&out, Sentence(plan), "\n");
    absl::StrAppendFormat(&out, "core-hours: %s%.3f, of %.3f for all anew (%.1f %%)\n",
                          plan.at("from_scratch").get<bool>() ? "at most " : "", seconds / kSecondsPerHour,
                          in_full / kSecondsPerHour, in_full > 0 ? 100 * seconds / in_full : 0);
    absl::StrAppendFormat(&out, "disk: %s%.2f GiB, of %.2f\n", plan.at("from_scratch").get<bool>() ? "at most " : "",
                          predicted.at("stored_bytes").get<double>() / kBytesPerGiB,
                          predicted.at("stored_bytes_in_full").get<double>() / kBytesPerGiB);
    if (terms.price_per_core_hour) {
      absl::StrAppendFormat(&out, "price: %.2f, of %.2f\n", *terms.price_per_core_hour * seconds / kSecondsPerHour,
                            *terms.price_per_core_hour * in_full / kSecondsPerHour);
    }
    return out;
  });
}

StatusOr<std::string> UpdateSummary(const std::string& text) { return FromJson(text, Sentence); }

StatusOr<std::string> UpdateMap(const std::string& text) {
  return FromJson(text, [](const json& plan) {
    const double cell_m = plan.at("cell_m");
    double x0 = 1e300, y0 = 1e300, x1 = -1e300, y1 = -1e300;
    const auto include = [&](double x, double y) {
      x0 = std::min(x0, x);
      x1 = std::max(x1, x);
      y0 = std::min(y0, y);
      y1 = std::max(y1, y);
    };
    for (const json& tile : plan.at("tiles")) {
      const json& core = tile.at("core");
      include(core.at(0).get<double>() * cell_m, core.at(1).get<double>() * cell_m);
      include(core.at(2).get<double>() * cell_m, core.at(3).get<double>() * cell_m);
    }
    for (const json& camera : plan.at("cameras")) include(camera.at("at").at(0), camera.at("at").at(1));
    const double size = std::max({x1 - x0, y1 - y0, 1e-9}), margin = 0.03 * size, line = size / 600, letter = size / 45;
    std::string out = absl::StrFormat(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"900\" viewBox=\"%.3f %.3f %.3f %.3f\" "
        "font-family=\"sans-serif\" font-size=\"%.3f\">\n",
        x0 - margin, -y1 - margin, x1 - x0 + 2 * margin, y1 - y0 + 2 * margin + 3 * letter, letter);
    for (const json& tile : plan.at("tiles")) {
      const json& core = tile.at("core");
      const double left = core.at(0).get<double>() * cell_m, bottom = core.at(1).get<double>() * cell_m;
      const double right = core.at(2).get<double>() * cell_m, top = core.at(3).get<double>() * cell_m;
      const bool redone = IsRedone(tile);
      absl::StrAppendFormat(&out,
                            "<rect x=\"%.3f\" y=\"%.3f\" width=\"%.3f\" height=\"%.3f\" fill=\"%s\" stroke=\"#333\" "
                            "stroke-width=\"%.3f\"><title>tile %d: %s</title></rect>\n",
                            left, -top, right - left, top - bottom, redone ? "#d6604d" : "#f4efe4", line,
                            tile.at("tile").get<int>(),
                            redone                        ? absl::StrFormat("%.0f core-seconds", PredictedSeconds(tile))
                            : tile.at("redone").is_null() ? "as far as the changes reach"
                                                          : "kept");
    }
    for (const json& camera : plan.at("cameras")) {
      const double x = camera.at("at").at(0), y = camera.at("at").at(1);
      const char* const style = camera.at("state") == "new"         ? "fill=\"#06c\""
                                : camera.at("state") == "withdrawn" ? "fill=\"none\" stroke=\"#c00\""
                                                                    : "fill=\"none\" stroke=\"#888\"";
      absl::StrAppendFormat(&out, "<circle cx=\"%.3f\" cy=\"%.3f\" r=\"%.3f\" stroke-width=\"%.3f\" %s/>\n", x, -y,
                            2.5 * line, 0.7 * line, style);
    }
    absl::StrAppendFormat(&out, "<text x=\"%.3f\" y=\"%.3f\">%s (red); dots: new cameras</text>\n", x0,
                          -y0 + margin + 1.5 * letter, Sentence(plan));
    return out + "</svg>\n";
  });
}

}  // namespace tessera
