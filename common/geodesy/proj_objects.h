// PROJ's objects with their owners, and the choice of an operation between two of its coordinate reference systems.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"

struct PJconsts;  // PJ and PJ_CONTEXT of proj.h
struct pj_ctx;

namespace tessera {

struct ProjObjectDeleter {
  void operator()(PJconsts* object) const;
};
using ProjObject = std::unique_ptr<PJconsts, ProjObjectDeleter>;

// A context without network that keeps PROJ's last message. Not thread-safe.
class ProjContext {
 public:
  // INTERNAL if PROJ cannot start.
  static StatusOr<std::unique_ptr<ProjContext>> Make();
  ProjContext(const ProjContext&) = delete;
  ProjContext& operator=(const ProjContext&) = delete;
  ~ProjContext();

  pj_ctx* get() const { return context_; }
  // PROJ's last message, for errors; reading it resets it.
  std::string TakeMessage();
  // The object that PROJ reads from `text`; null if it reads none.
  ProjObject Create(const std::string& text);

 private:
  ProjContext() = default;
  pj_ctx* context_ = nullptr;
  std::string message_;
};

struct ProjAxis {
  double unit = 1;  // in metres or radians
  std::string unit_name, direction;
};

// The system inside one that has a transformation to WGS 84 of its own (TOWGS84); of another one, a copy.
ProjObject ProjBaseOf(pj_ctx* context, const PJconsts* crs);
// Empty if `crs` is null or has no coordinate system.
std::vector<ProjAxis> ProjAxesOf(pj_ctx* context, const PJconsts* crs);
// The EPSG code that the definition states, or of the system of EPSG that equals it but for names; 0: none.
int ProjEpsgOf(pj_ctx* context, const PJconsts* crs);

// An operation between two systems in the order (easting or longitude, northing or latitude, height).
struct ProjOperation {
  ProjObject object;  // null: there is none
  std::string name;
  double accuracy_m = -1;              // as PROJ states it; 0 for a mere projection, -1: not known
  bool covers = false;                 // its area of use has the point
  std::set<std::string> better_grids;  // missing grids of more accurate operations
};

// The most accurate operation from `source` to `target` whose grids are installed, that is no ballpark operation and
// that maps the point `near`: of `source`, or of `target` if `near_is_image`. Operations whose area of use has the
// point come first. `lon_lat_deg` of the point in `target` (not finite if there is none) is the place to compare with
// areas of use; if the place is not finite, the grids of all areas count.
ProjOperation ChooseOperation(const ProjContext& context, const PJconsts* source, const PJconsts* target,
                              const Eigen::Vector3d& near, bool near_is_image,
                              const std::function<Eigen::Vector2d(const Eigen::Vector3d& image)>& lon_lat_deg);

// Transforms one point, forward or backward. Not finite if it has no image.
Eigen::Vector3d Transform(const ProjOperation& operation, bool forward, const Eigen::Vector3d& point);

}  // namespace tessera
