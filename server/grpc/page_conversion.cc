// Conversions of what pages show: tiles, views, settings, quotes.
#include <cmath>
#include <numbers>

#include "server/grpc/conversion.h"

namespace tessera {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Steps of figures of tiles. Further digits are of no use, and do not compress.
constexpr double kPerSecond = 1e3, kPerShare = 1e4;

double Rounded(double value, double per_unit) { return std::round(value * per_unit) / per_unit; }

void SetInterval(const std::optional<Interval>& interval, v1::Interval* (v1::Quote::*field)(), v1::Quote* proto) {
  if (!interval) return;
  v1::Interval& set = *(proto->*field)();
  set.set_low(interval->low);
  set.set_high(interval->high);
}

}  // namespace

void ToProto(const ListedTile& tile, v1::Tile* proto) {
  const TileStatus& status = tile.status;
  proto->set_tile(status.tile);
  for (const GroundRect& rect : tile.place.core) {
    v1::GroundRectangle& added = *proto->add_core();
    added.set_x0_m(rect.x0_m);
    added.set_y0_m(rect.y0_m);
    added.set_x1_m(rect.x1_m);
    added.set_y1_m(rect.y1_m);
  }
  proto->set_state(static_cast<v1::TileState>(status.state));
  proto->set_attempts(status.attempts);
  proto->set_failed_attempts(status.failed_attempts);
  proto->set_core_seconds(Rounded(status.core_seconds, kPerSecond));
  proto->set_predicted_core_seconds(Rounded(status.predicted_core_seconds, kPerSecond));
  proto->set_peak_bytes(status.peak_bytes);
  proto->set_predicted_peak_bytes(status.predicted_peak_bytes);
  proto->mutable_views()->Assign(tile.place.views.begin(), tile.place.views.end());
  proto->set_task(status.task);
  proto->set_title(status.title);
  proto->set_stage(status.stage);
  proto->set_worker(status.worker);
  for (const std::string& reason : status.reasons) proto->add_reasons(reason);
  proto->mutable_waits_for()->Assign(status.waits_for.begin(), status.waits_for.end());
  proto->set_tasks_total(status.tasks_total);
  proto->set_tasks_done(status.tasks_done);
  proto->set_tasks_reused(status.tasks_reused);
  proto->set_confidence(Rounded(tile.confidence, kPerShare));
  proto->set_progress(Rounded(status.progress, kPerShare));
}

void ToProto(const ListedView& listed, v1::View* proto) {
  const MapView& view = listed.view;
  proto->set_image(view.image);
  proto->set_x_m(view.centre.x());
  proto->set_y_m(view.centre.y());
  proto->set_z_m(view.centre.z());
  proto->set_direction_x(view.direction.x());
  proto->set_direction_y(view.direction.y());
  proto->set_direction_z(view.direction.z());
  proto->set_ground_x_m(view.on_ground.x());
  proto->set_ground_y_m(view.on_ground.y());
  proto->set_ground_direction_x(view.ground_heading.x());
  proto->set_ground_direction_y(view.ground_heading.y());
  proto->set_tiles_x_m(listed.in_tiles.x());
  proto->set_tiles_y_m(listed.in_tiles.y());
  proto->set_tiles_z_m(listed.in_tiles.z());
  proto->set_tiles_direction_x(listed.axis_in_tiles.x());
  proto->set_tiles_direction_y(listed.axis_in_tiles.y());
  proto->set_tiles_direction_z(listed.axis_in_tiles.z());
}

void ToProto(const PointOnMap& found, v1::LocatePointResponse* proto) {
  const LocatedPoint& point = found.point;
  proto->set_crs(point.crs);
  proto->set_x(point.p.x());
  proto->set_y(point.p.y());
  proto->set_z(point.p.z());
  proto->set_scene_x_m(point.in_scene.x());
  proto->set_scene_y_m(point.in_scene.y());
  proto->set_scene_z_m(point.in_scene.z());
  if (point.geodetic) {
    proto->set_on_globe(true);
    proto->set_latitude_deg(point.geodetic->x() * kDegrees);
    proto->set_longitude_deg(point.geodetic->y() * kDegrees);
    proto->set_height_m(point.geodetic->z());
  }
  proto->set_ground_x_m(found.on_ground.x());
  proto->set_ground_y_m(found.on_ground.y());
  proto->set_tile(found.tile);
}

void ToProto(const ListedSetting& setting, v1::Setting* proto) {
  proto->set_name(setting.name);
  proto->set_field(setting.field);
  proto->set_help(setting.help);
  proto->set_kind(static_cast<v1::SettingKind>(setting.kind));
  if (setting.minimum) proto->set_minimum(*setting.minimum);
  if (setting.maximum) proto->set_maximum(*setting.maximum);
  proto->set_unit(setting.unit);
  for (const auto& [method, value] : setting.defaults) (*proto->mutable_defaults())[method] = value;
  for (const std::string& choice : setting.choices) proto->add_choices(choice);
}

void ToProto(const JobQuote& quote, v1::Quote* proto) {
  ToProto(quote.settings, proto->mutable_settings());
  for (const std::string& warning : quote.warnings) proto->add_warnings(warning);
  proto->set_images(quote.images);
  proto->set_pixels(quote.pixels);
  proto->set_mesh_faces(quote.mesh_faces);
  proto->set_surveyed_by(quote.surveyed_by);
  SetInterval(quote.tiles, &v1::Quote::mutable_tiles, proto);
  SetInterval(quote.core_seconds, &v1::Quote::mutable_core_seconds, proto);
  SetInterval(quote.peak_bytes, &v1::Quote::mutable_peak_bytes, proto);
  SetInterval(quote.stored_bytes, &v1::Quote::mutable_stored_bytes, proto);
  SetInterval(quote.area_m2, &v1::Quote::mutable_area_m2, proto);
  proto->set_gsd_m(quote.gsd_m);
  for (const std::string& name : quote.estimated) proto->add_estimated(name);
  proto->set_basis(quote.basis);
}

}  // namespace tessera
