#include "worker/city/update_survey.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/parallel.h"
#include "worker/city/collected_faces.h"
#include "worker/city/view_box.h"

namespace tessera {
namespace {

constexpr int kPairSamples = 4000;

// Largest displacement in the image, from one view to the other, of points at depth `depth_m` in the first view.
// Covers pose and lens.
double Displacement_px(const SceneView& from, const SceneView& to, double depth_m) {
  constexpr int kSteps = 4;
  const PinholeCamera& k = from.camera.intrinsics;
  double farthest = 0;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel(k.width * i / static_cast<double>(kSteps),
                                  k.height * j / static_cast<double>(kSteps));
      const Eigen::Vector3d ray((pixel.x() - k.cx) / k.fx, (pixel.y() - k.cy) / k.fy, 1);
      const Eigen::Vector3d point =
          from.camera.rotation_cam_from_world.transpose() * (ray * depth_m - from.camera.translation_cam_from_world);
      const Eigen::Vector3d moved = to.camera.Project(point);
      if (moved.z() <= 0) return std::numeric_limits<double>::infinity();
      farthest = std::max(farthest, (to.lens.Distort(moved.head<2>()) - from.lens.Distort(pixel)).norm());
    }
  }
  return farthest;
}

class ViewUpdater {
 public:
  ViewUpdater(const SceneDescription& scene, const std::map<std::string, std::string>& carried, Survey* survey)
      : scene_(scene),
        carried_(carried),
        survey_(*survey),
        base_views_(survey->views.size()),
        matched_(base_views_, 0) {
    changes_.changed.assign(base_views_, 0);
    for (size_t v = 0; v < base_views_; ++v) {
      if (survey->views[v].withdrawn) continue;
      by_content_.emplace(survey->views[v].image_content, v);
      by_name_.emplace(survey->views[v].name, v);
    }
  }

  Status UpdateFlights(const std::vector<std::string>& withdraw) {
    std::vector<Flight>& flights = survey_.flights;
    for (const std::string& name : withdraw) {
      const auto found =
          std::find_if(flights.begin(), flights.end(), [&](const Flight& flight) { return flight.name == name; });
      if (found == flights.end()) {
        const auto names = [](std::string* out, const Flight& flight) { absl::StrAppend(out, "'", flight.name, "'"); };
        return absl::InvalidArgumentError(
            absl::StrCat("withdraw: found flight '", name, "', expected a flight of the base job: ",
                         flights.empty() ? "it has none" : absl::StrJoin(flights, ", ", names)));
      }
      withdrawn_flights_.insert(static_cast<int>(found - flights.begin()));
    }
    for (const Flight& flight : scene_.flights) {
      const auto found =
          std::find_if(flights.begin(), flights.end(), [&](const Flight& other) { return other.name == flight.name; });
      flight_.push_back(static_cast<int>(found - flights.begin()));
      if (found == flights.end()) {
        flights.push_back(flight);
      } else {
        found->date = flight.date;
      }
    }
    return absl::OkStatus();
  }

  void UpdateAll(bool whole) {
    // Match by content first: a reused file name must not replace the view whose image was renamed.
    std::vector<const SceneView*> left, unnamed;
    for (const SceneView& view : scene_.views) {
      if (const int number = FindSame(view); number >= 0) {
        Replace(view, static_cast<size_t>(number));
      } else {
        unnamed.push_back(&view);
      }
    }
    for (const SceneView* view : unnamed) {
      const auto found = whole ? by_name_.find(view->name) : by_name_.end();
      if (found == by_name_.end() || matched_[found->second]) {
        left.push_back(view);
      } else {
        Replace(*view, found->second);
      }
    }
    for (size_t v = 0; v < base_views_; ++v) {
      SceneView& view = survey_.views[v];
      if (!matched_[v] && !whole && !view.withdrawn) {
        Carry(&view.image_path);
        Carry(&view.mask_path);
        Carry(&view.likelihood_path);
      }
      if ((matched_[v] || !whole) && !withdrawn_flights_.contains(view.flight)) continue;
      if (!view.withdrawn) {
        ++changes_.withdrawn;
        changes_.changed[v] = 1;
      }
      view.withdrawn = true;
      view.image_path.clear();
      view.mask_path.clear();
      view.likelihood_path.clear();
    }
    std::sort(left.begin(), left.end(), [](const SceneView* a, const SceneView* b) { return a->name < b->name; });
    for (const SceneView* view : left) {
      survey_.views.push_back(*view);
      survey_.views.back().flight = view->flight < 0 ? OwnFlight() : FlightOf(*view);
      changes_.changed.push_back(1);
      ++changes_.added;
    }
  }

  ViewChanges TakeChanges() { return std::move(changes_); }

 private:
  int FlightOf(const SceneView& view) const { return view.flight < 0 ? -1 : flight_[view.flight]; }

  // Flight of new images for which the scene names none: one flight with the scene's name.
  int OwnFlight() {
    if (own_flight_ < 0) {
      own_flight_ = static_cast<int>(survey_.flights.size());
      survey_.flights.push_back({scene_.name, ""});
    }
    return own_flight_;
  }

  void Carry(std::string* path) const {
    if (const auto found = carried_.find(*path); found != carried_.end()) *path = found->second;
  }

  // The base's view with this content; if there are several, the one of the same name, else the nearest. -1: none.
  int FindSame(const SceneView& view) const {
    int best = -1;
    double nearest_m = std::numeric_limits<double>::infinity();
    const auto [begin, end] = by_content_.equal_range(view.image_content);
    for (auto it = begin; it != end; ++it) {
      const SceneView& other = survey_.views[it->second];
      if (matched_[it->second] || other.likelihood_content != view.likelihood_content) continue;
      if (other.name == view.name) return static_cast<int>(it->second);
      const double apart_m = (other.camera.Centre() - view.camera.Centre()).norm();
      if (apart_m < nearest_m) best = static_cast<int>(it->second);
      nearest_m = std::min(nearest_m, apart_m);
    }
    return best;
  }

  void Replace(const SceneView& view, size_t number) {
    matched_[number] = 1;
    SceneView& known = survey_.views[number];
    if (known.image_content != view.image_content || known.likelihood_content != view.likelihood_content) {
      ++changes_.replaced;
    }
    SceneView taken = view;
    taken.flight = FlightOf(view);
    if (!(known.camera == view.camera && known.lens == view.lens)) {
      const auto [near_m, far_m] = survey_.view_depths[number];
      const double moved_px = std::max(Displacement_px(known, view, near_m), Displacement_px(known, view, far_m));
      if (moved_px < kSnap_px) {
        taken.camera = known.camera;
        taken.lens = known.lens;
        ++changes_.snapped;
      } else {
        changes_.changed[number] = 1;
        survey_.view_depths[number] = {0, 0};
        ++changes_.moved;
      }
    }
    known = std::move(taken);
  }

  const SceneDescription& scene_;
  const std::map<std::string, std::string>& carried_;
  Survey& survey_;
  const size_t base_views_;
  std::vector<uint8_t> matched_;                   // per view of the base: in the scene
  std::multimap<std::string, size_t> by_content_;  // views that are not withdrawn, by image content
  std::map<std::string, size_t> by_name_;
  std::vector<int> flight_;  // survey index of each of the scene's flights
  std::set<int> withdrawn_flights_;
  int own_flight_ = -1;
  ViewChanges changes_;
};

// Epochs increase with the flights' dates. A flight without a date is newer than all flights that the job had before
// it. Views without a flight have epoch -1, older than all others.
std::vector<int> EpochsOf(const Survey& survey) {
  std::vector<std::pair<std::string, size_t>> order;
  std::string latest;
  for (size_t i = 0; i < survey.flights.size(); ++i) {
    const std::string& date = survey.flights[i].date;
    order.emplace_back(date.empty() ? latest : date, i);
    latest = std::max(latest, date);
  }
  std::sort(order.begin(), order.end());
  std::vector<int> epoch(order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const Flight& flight = survey.flights[order[i].second];
    const bool same_day = i > 0 && !flight.date.empty() && flight.date == survey.flights[order[i - 1].second].date;
    epoch[order[i].second] = same_day ? epoch[order[i - 1].second] : static_cast<int>(i);
  }
  std::vector<int> of_view;
  for (const SceneView& view : survey.views) of_view.push_back(view.flight < 0 ? -1 : epoch[view.flight]);
  return of_view;
}

bool AnyChanged(const std::vector<int32_t>& views, const std::vector<uint8_t>& changed) {
  return std::any_of(views.begin(), views.end(), [&](int32_t v) { return changed[v] != 0; });
}

// Selects pairs among the views in use; unchanged pairs are kept. `epochs`: as CellViewOptions::epoch_of_view. Each
// view also gets partners of its own epoch, for cells that use only that epoch.
void ChoosePartners(const TriangleMesh& samples, const ViewChanges& changes, const std::vector<int>& epochs,
                    const PairOptions& asked, Survey* survey) {
  std::vector<uint8_t> chooses = changes.changed;
  std::vector<std::array<int32_t, 2>> pairs;
  for (const auto& pair : survey->pairs) {
    if (changes.changed[pair[0]] || changes.changed[pair[1]]) {
      chooses[pair[0]] = chooses[pair[1]] = 1;
    } else {
      pairs.push_back(pair);
    }
  }
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : samples.vertices) box.extend(p);
  std::vector<int32_t> in_play;
  std::map<int, std::vector<int32_t>> of_epoch;  // views in use per epoch, for epochs with a changed view
  for (size_t v = 0; v < survey->views.size(); ++v) {
    if (survey->views[v].withdrawn || !MayShow(survey->views[v].camera, box)) continue;
    in_play.push_back(static_cast<int32_t>(v));
    if (!epochs.empty() && chooses[v]) of_epoch[epochs[v]];
  }
  for (const int32_t v : in_play) {
    if (epochs.empty()) break;
    if (const auto epoch = of_epoch.find(epochs[v]); epoch != of_epoch.end()) epoch->second.push_back(v);
  }
  PairOptions options = asked;
  options.samples = static_cast<int>(samples.faces.size());
  const auto add_partners = [&](const std::vector<int32_t>& views) {
    std::vector<PosedCamera> cameras;
    std::vector<uint8_t> choosers;
    for (const int32_t v : views) {
      cameras.push_back(survey->views[v].camera);
      choosers.push_back(chooses[v]);
    }
    for (const ViewPair& pair : SelectPairs(samples, cameras, options, choosers)) {
      pairs.push_back({views[pair.reference], views[pair.other]});
    }
  };
  add_partners(in_play);
  for (const auto& [epoch, views] : of_epoch) {
    if (views.size() < in_play.size()) add_partners(views);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  survey->pairs = std::move(pairs);
}

}  // namespace

StatusOr<ViewChanges> UpdateViews(const SceneDescription& scene, bool whole, const UpdateParameters& parameters,
                                  const std::map<std::string, std::string>& carried, Survey* survey) {
  if (scene.has_likelihoods != survey->has_likelihoods) {
    return InputError(scene.folder, "likelihoods", scene.has_likelihoods ? "some" : "none",
                      survey->has_likelihoods ? "some, as in the base job" : "none, as in the base job");
  }
  const auto names = [](const std::vector<SceneClass>& classes) {
    return absl::StrJoin(classes, ", ", [](std::string* out, const SceneClass& c) { absl::StrAppend(out, c.name); });
  };
  if (scene.has_likelihoods && names(scene.classes) != names(survey->classes)) {
    return InputError(scene.folder + "/scene.json", "classes", names(scene.classes),
                      absl::StrCat(names(survey->classes), ", as in the base job"));
  }
  ViewUpdater updater(scene, carried, survey);
  TESSERA_RETURN_IF_ERROR(updater.UpdateFlights(parameters.withdraw));
  updater.UpdateAll(whole);
  const bool any =
      std::any_of(survey->views.begin(), survey->views.end(), [](const SceneView& view) { return !view.withdrawn; });
  if (!any)
    return absl::InvalidArgumentError(
        "the update leaves no images: all images of the base job are withdrawn and none is added");
  return updater.TakeChanges();
}

Status UpdateViewSelection(const CityReader& city, const ViewChanges& changes, bool all_epochs,
                           const CellViewOptions& asked, const PairOptions& pairs, const TaskControl& control,
                           Survey* survey) {
  std::map<std::pair<int, int>, size_t> cell_at;
  std::vector<uint8_t> touched(survey->cells.size(), 0);
  for (size_t c = 0; c < touched.size(); ++c) {
    const SurveyCell& cell = survey->cells[c];
    cell_at[{cell.x, cell.y}] = c;
    touched[c] = IsRevised(*survey, cell.x, cell.y) || AnyChanged(cell.views, changes.changed);
    for (size_t v = 0; v < survey->views.size() && !touched[c]; ++v) {
      touched[c] = changes.changed[v] && !survey->views[v].withdrawn &&
                   MayShow(survey->views[v].camera, {cell.box_min, cell.box_max});
    }
  }
  std::vector<Eigen::Vector3d> centres;
  for (const SceneView& view : survey->views) centres.push_back(view.camera.Centre());
  // The affected blocks, the views that may show them, and the blocks that may occlude them.
  std::vector<size_t> blocks;
  std::vector<std::vector<size_t>> candidates;
  std::vector<uint8_t> between(city.block_count(), 0);
  for (size_t b = 0; b < city.block_count(); ++b) {
    const bool any = std::any_of(cell_at.begin(), cell_at.end(), [&](const auto& at) {
      return touched[at.second] && city.cells(b).Contains({at.first.first, at.first.second});
    });
    if (!any) continue;
    blocks.push_back(b);
    std::vector<size_t>& showing = candidates.emplace_back();
    for (size_t v = 0; v < survey->views.size(); ++v) {
      if (!survey->views[v].withdrawn && MayShow(survey->views[v].camera, city.box(b))) showing.push_back(v);
    }
    for (const size_t v : showing) {
      Eigen::AlignedBox3d lines_of_sight = city.box(b);
      lines_of_sight.extend(centres[v]);
      for (size_t other = 0; other < between.size(); ++other)
        between[other] |= city.box(other).intersects(lines_of_sight);
    }
  }
  if (blocks.empty()) return absl::OkStatus();
  CellViewOptions options = asked;
  if (!all_epochs) options.epoch_of_view = EpochsOf(*survey);
  OcclusionTest occlusion(options.occlusion_margin_gsd * survey->gsd_m);
  FaceCollector collector;
  for (size_t b = 0; b < between.size(); ++b) {
    if (!between[b]) continue;
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    for (size_t f = 0; f < block.face_ids.size(); ++f) collector.Add(block, f);
  }
  {
    const CollectedFaces around = collector.Finish();
    occlusion.SetNear(around.mesh);
  }
  TriangleMesh samples;  // faces of the affected blocks, evenly spaced
  int64_t faces = 0;
  for (const size_t b : blocks) {
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    faces += static_cast<int64_t>(block.face_ids.size());
  }
  const auto step = static_cast<size_t>(std::max<int64_t>(1, faces / kPairSamples));
  for (size_t i = 0; i < blocks.size(); ++i) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(i) / static_cast<double>(blocks.size()), "selecting views");
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(blocks[i]));
    for (size_t f = step / 2; f < block.mesh.faces.size(); f += step) {
      const auto first = static_cast<uint32_t>(samples.vertices.size());
      for (int k = 0; k < 3; ++k) samples.vertices.push_back(block.mesh.Corner(f, k));
      samples.faces.push_back({first, first + 1, first + 2});
    }
    const auto faces_of = FacesOfCells(block, survey->ground);
    std::vector<std::pair<SurveyCell*, const std::vector<uint32_t>*>> cells;
    for (const auto& [at, of_cell] : faces_of) {
      const size_t c = cell_at.at(at);
      if (touched[c]) cells.emplace_back(&survey->cells[c], &of_cell);
    }
    ParallelForEach(cells.size(), 1, [&](int64_t c) {
      if (!control.Check().ok()) return;
      std::vector<int32_t> views =
          ChooseViewsOfCell(block.mesh, *cells[c].second, occlusion, centres, candidates[i], *survey, options);
      std::vector<int32_t>& known = cells[c].first->views;
      if (IsRevised(*survey, cells[c].first->x, cells[c].first->y) || AnyChanged(views, changes.changed) ||
          AnyChanged(known, changes.changed)) {
        known = std::move(views);
      }
    });
  }
  TESSERA_RETURN_IF_ERROR(control.Check());
  ChoosePartners(samples, changes, options.epoch_of_view, pairs, survey);
  return absl::OkStatus();
}

}  // namespace tessera
