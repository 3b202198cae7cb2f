#include "common/geodesy/proj_objects.h"

#include <proj.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

namespace tessera {
namespace {

struct ProjListDeleter {
  void operator()(PJ_OBJ_LIST* list) const { proj_list_destroy(list); }
};
struct ProjFactoryDeleter {
  void operator()(PJ_OPERATION_FACTORY_CONTEXT* factory) const { proj_operation_factory_context_destroy(factory); }
};

// The names of the grids that `operation` needs and that are not installed.
std::set<std::string> MissingGrids(pj_ctx* context, const PJ* operation) {
  std::set<std::string> missing;
  const int count = proj_coordoperation_get_grid_used_count(context, operation);
  for (int k = 0; k < count; ++k) {
    const char* name = nullptr;
    int available = 0;
    if (proj_coordoperation_get_grid_used(context, operation, k, &name, nullptr, nullptr, nullptr, nullptr, nullptr,
                                          &available) != 0 &&
        available == 0 && name != nullptr) {
      missing.insert(name);
    }
  }
  return missing;
}

// Whether the area of use has the point; areas may cross the antimeridian. An unknown area has every point.
bool AreaHas(pj_ctx* context, const PJ* object, const Eigen::Vector2d& lon_lat_deg) {
  double west = 0, south = 0, east = 0, north = 0;
  if (proj_get_area_of_use(context, object, &west, &south, &east, &north, nullptr) == 0 || west < -1000) return true;
  if (!(lon_lat_deg.y() >= south && lon_lat_deg.y() <= north)) return false;
  const auto eastward = [&](double lon_deg) {
    const double angle = std::remainder(lon_deg - west, 360);
    return angle < 0 ? angle + 360 : angle;
  };
  return east - west >= 360 || eastward(lon_lat_deg.x()) <= eastward(east);
}

double AccuracyOf(pj_ctx* context, const PJ* operation) {
  const double accuracy_m = proj_coordoperation_get_accuracy(context, operation);
  return accuracy_m < 0 && proj_get_type(operation) == PJ_TYPE_CONVERSION ? 0 : accuracy_m;
}

}  // namespace

void ProjObjectDeleter::operator()(PJconsts* object) const { proj_destroy(object); }

StatusOr<std::unique_ptr<ProjContext>> ProjContext::Make() {
  std::unique_ptr<ProjContext> out(new ProjContext);
  out->context_ = proj_context_create();
  if (out->context_ == nullptr) return absl::InternalError("PROJ cannot make a context");
  proj_context_set_enable_network(out->context_, 0);
  proj_log_level(out->context_, PJ_LOG_ERROR);
  proj_log_func(out->context_, &out->message_,
                [](void* message, int, const char* text) { *static_cast<std::string*>(message) = text; });
  return out;
}

ProjContext::~ProjContext() {
  if (context_ != nullptr) proj_context_destroy(context_);
}

std::string ProjContext::TakeMessage() { return std::exchange(message_, std::string()); }

ProjObject ProjContext::Create(const std::string& text) { return ProjObject(proj_create(context_, text.c_str())); }

ProjObject ProjBaseOf(pj_ctx* context, const PJ* crs) {
  return ProjObject(proj_get_type(crs) == PJ_TYPE_BOUND_CRS ? proj_get_source_crs(context, crs)
                                                            : proj_clone(context, crs));
}

std::vector<ProjAxis> ProjAxesOf(pj_ctx* context, const PJ* crs) {
  std::vector<ProjAxis> axes;
  const ProjObject system(crs == nullptr ? nullptr : proj_crs_get_coordinate_system(context, crs));
  const int count = system == nullptr ? 0 : proj_cs_get_axis_count(context, system.get());
  for (int k = 0; k < count; ++k) {
    ProjAxis axis;
    const char *direction = nullptr, *unit_name = nullptr;
    if (proj_cs_get_axis_info(context, system.get(), k, nullptr, nullptr, &direction, &axis.unit, &unit_name, nullptr,
                              nullptr) == 0 ||
        !(axis.unit > 0)) {
      return {};
    }
    if (direction != nullptr) axis.direction = direction;
    if (unit_name != nullptr) axis.unit_name = unit_name;
    axes.push_back(axis);
  }
  return axes;
}

int ProjEpsgOf(pj_ctx* context, const PJ* crs) {
  const auto code = [](const PJ* object) {
    const char *authority = proj_get_id_auth_name(object, 0), *text = proj_get_id_code(object, 0);
    int value = 0;
    if (authority == nullptr || text == nullptr || std::string_view(authority) != "EPSG") return 0;
    std::from_chars(text, text + std::string_view(text).size(), value);
    return value;
  };
  if (const int stated = code(crs); stated > 0) return stated;
  constexpr int kEqualButNames = 70;  // per cent
  int* confidences = nullptr;
  PJ_OBJ_LIST* const list = proj_identify(context, crs, "EPSG", nullptr, &confidences);
  int found = 0;
  if (list != nullptr && proj_list_get_count(list) > 0 && confidences[0] >= kEqualButNames) {
    found = code(ProjObject(proj_list_get(context, list, 0)).get());
  }
  proj_int_list_destroy(confidences);
  proj_list_destroy(list);
  return found;
}

ProjOperation ChooseOperation(const ProjContext& context, const PJ* source, const PJ* target,
                              const Eigen::Vector3d& near, bool near_is_image,
                              const std::function<Eigen::Vector2d(const Eigen::Vector3d& image)>& lon_lat_deg) {
  pj_ctx* const c = context.get();
  const std::unique_ptr<PJ_OPERATION_FACTORY_CONTEXT, ProjFactoryDeleter> factory(
      proj_create_operation_factory_context(c, nullptr));
  ProjOperation best;
  if (factory == nullptr) return best;
  proj_operation_factory_context_set_allow_ballpark_transformations(c, factory.get(), 0);
  proj_operation_factory_context_set_spatial_criterion(c, factory.get(), PROJ_SPATIAL_CRITERION_PARTIAL_INTERSECTION);
  // Operations with missing grids are listed, so that messages can name the grids.
  proj_operation_factory_context_set_grid_availability_use(c, factory.get(), PROJ_GRID_AVAILABILITY_USED_FOR_SORTING);
  const std::unique_ptr<PJ_OBJ_LIST, ProjListDeleter> list(proj_create_operations(c, source, target, factory.get()));
  const int count = list == nullptr ? 0 : proj_list_get_count(list.get());
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  double best_accuracy_m = kUnknown;
  std::vector<std::pair<double, ProjObject>> lacking;  // operations with missing grids, and their accuracy
  for (int k = 0; k < count; ++k) {
    ProjObject found(proj_list_get(c, list.get(), k));
    if (found == nullptr || proj_coordoperation_has_ballpark_transformation(c, found.get())) continue;
    const double stated_m = AccuracyOf(c, found.get());
    const double accuracy_m = stated_m < 0 ? kUnknown : stated_m;
    if (!MissingGrids(c, found.get()).empty()) {
      lacking.emplace_back(accuracy_m, std::move(found));
      continue;
    }
    if (!proj_coordoperation_is_instantiable(c, found.get())) continue;
    ProjOperation operation;
    operation.object.reset(proj_normalize_for_visualization(c, found.get()));
    if (operation.object == nullptr) continue;
    const Eigen::Vector3d other = Transform(operation, !near_is_image, near);
    if (!other.allFinite()) continue;
    operation.covers = AreaHas(c, found.get(), lon_lat_deg(near_is_image ? near : other));
    const bool better = best.object == nullptr || operation.covers > best.covers ||
                        (operation.covers == best.covers && accuracy_m < best_accuracy_m);
    if (!better) continue;
    operation.name = proj_get_name(found.get());
    operation.accuracy_m = stated_m;
    best = std::move(operation);
    best_accuracy_m = accuracy_m;
  }
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector3d image(kNaN, kNaN, kNaN);
  if (near_is_image) image = near;
  if (!near_is_image && best.object != nullptr) image = Transform(best, true, near);
  const Eigen::Vector2d place = lon_lat_deg(image);
  for (const auto& [accuracy_m, operation] : lacking) {
    if (best.covers && accuracy_m >= best_accuracy_m) continue;
    if (place.allFinite() && !AreaHas(c, operation.get(), place)) continue;
    best.better_grids.merge(MissingGrids(c, operation.get()));
  }
  return best;
}

Eigen::Vector3d Transform(const ProjOperation& operation, bool forward, const Eigen::Vector3d& point) {
  // No time: operations that depend on it take their epoch.
  PJ* const object = operation.object.get();
  proj_errno_reset(object);
  const PJ_COORD out =
      proj_trans(object, forward ? PJ_FWD : PJ_INV, proj_coord(point.x(), point.y(), point.z(), HUGE_VAL));
  return {out.xyz.x, out.xyz.y, out.xyz.z};
}

}  // namespace tessera
