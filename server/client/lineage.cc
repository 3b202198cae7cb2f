#include "server/client/lineage.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/task_kinds.h"

namespace tessera {
namespace {

using nlohmann::json;

Digest DigestFrom(const json& output) { return {output.at("sha256"), output.at("size_bytes").get<int64_t>()}; }

// Collects the survey and the tile states among the task's outputs.
void AddTask(const json& task, LineageJob* job) {
  const std::string kind = task.at("kind");
  const json& outputs = task.at("outputs");
  // The first one: the second split changes no image.
  if (const auto survey = outputs.find(kSurveyFile); survey != outputs.end() && job->survey.sha256.empty()) {
    job->survey = DigestFrom(*survey);
  }
  if (const auto state = outputs.find(kStateFile); state != outputs.end()) {
    job->made[task.at("tile").get<int>()] = DigestFrom(*state);  // tasks are in the plan's order: keep the last state
  }
  if (kind == kBaseKind) {
    const std::string state_name = absl::StrCat("/", kStateFile);  // of TileInputName
    for (const auto& [name, output] : outputs.items()) {
      if (name.ends_with(state_name)) job->inherited[std::stoi(name)] = DigestFrom(output);
    }
  }
}

// Index of the job from which job `index` inherited the tile; the size of the chain if there is none.
size_t InheritedFrom(const std::vector<LineageJob>& chain, size_t index, int tile) {
  const LineageJob& job = chain[index];
  if (!job.rolled_back.contains(tile)) return index + 1;
  const auto from = std::find_if(chain.begin() + static_cast<std::ptrdiff_t>(index), chain.end(),
                                 [&](const LineageJob& each) { return each.name == job.rollback_to; });
  return static_cast<size_t>(from - chain.begin());
}

}  // namespace

StatusOr<LineageJob> ParseLineageJob(const std::string& job_text, const std::string& update_text) {
  LineageJob job;
  std::string publish;
  std::string section;  // top-level key being parsed
  const auto take = [&](int depth, json::parse_event_t event, json& value) {
    if (depth == 1 && event == json::parse_event_t::key) section = value.get<std::string>();
    if (depth != 2 || event != json::parse_event_t::object_end || section != "tasks") return true;
    AddTask(value, &job);
    if (value.at("kind") == kPublishKind) publish = value.at("parameters").dump();
    return false;  // discard the parsed task
  };
  try {
    const json head = json::parse(job_text, take);
    job.name = head.at("name");
    job.display_name = head.at("display_name");
    if (head.contains("base") && head["base"].is_string()) job.base = head["base"];
    job.algorithm_version = head.value("algorithm_version", "");
    job.method = head.at("settings").at("method");
    job.from_scratch = head["settings"].value("from_scratch", false);
    if (head.contains("rollback")) {
      job.rollback_to = head["rollback"].at("to");
      job.rolled_back = head["rollback"].at("tiles").get<std::set<int>>();
    }
    if (!update_text.empty()) {
      const json update = json::parse(update_text);
      for (const json& tile : update.at("tiles")) {
        std::vector<RedoReason> reasons;
        for (const json& why : tile.at("why")) reasons.push_back({why.at("reason"), why.at("images")});
        if (!reasons.empty()) job.redos[tile.at("tile").get<int>()] = std::move(reasons);
      }
    }
  } catch (const std::exception& e) {  // thrown by JSON parsing and by std::stoi
    return absl::DataLossError(absl::StrCat(job.name, ": job.json or ", kUpdateFile, ": ", e.what()));
  }
  if (publish.empty()) {
    return absl::FailedPreconditionError(job.name + " has no result: it is a plan, expected a job that refined tiles");
  }
  if (job.survey.sha256.empty())
    return absl::DataLossError(job.name + ": job.json: found no survey among the task outputs");
  const StatusOr<PublishParameters> parameters = ParsePublishParameters(publish);
  if (!parameters.ok()) return absl::DataLossError(absl::StrCat(job.name, ": ", parameters.status().message()));
  job.tiles = parameters->tiles;
  return job;
}

std::vector<FlightImages> ImagesOfTile(const Survey& survey, const CellRect& core) {
  std::set<int32_t> views;
  for (const SurveyCell& cell : survey.cells) {
    if (core.Contains({cell.x, cell.y})) views.insert(cell.views.begin(), cell.views.end());
  }
  std::map<int, std::vector<std::string>> of_flight;
  for (const int32_t view : views) of_flight[survey.views[view].flight].push_back(survey.views[view].name);
  std::vector<FlightImages> found;
  for (auto& [flight, images] : of_flight) {
    std::sort(images.begin(), images.end());
    const bool named = flight >= 0 && flight < static_cast<int>(survey.flights.size());
    found.push_back(
        {named ? survey.flights[flight].name : "", named ? survey.flights[flight].date : "", std::move(images)});
  }
  return found;
}

StatusOr<Lineage> TraceTiles(std::vector<LineageJob> chain) {
  Lineage lineage;
  for (const TileParameters& tile : chain.front().tiles) {
    if (tile.core.empty()) continue;  // the update removed the tile
    TileLineage traced = {tile, 0, {}, std::nullopt};
    const LineageJob* inheritor = nullptr;  // the job before in the chain, which inherited the tile
    while (traced.made_by < chain.size()) {
      const LineageJob& job = chain[traced.made_by];
      const auto made = job.made.find(tile.tile), inherited = job.inherited.find(tile.tile);
      const bool here = made != job.made.end();
      if (!here && inherited == job.inherited.end()) {
        return absl::DataLossError(
            absl::StrCat(job.name, ": tile ", tile.tile, " has no state, neither refined nor inherited"));
      }
      traced.state = here ? made->second : inherited->second;
      if (inheritor != nullptr && !(inheritor->inherited.at(tile.tile) == traced.state)) {
        return absl::DataLossError(absl::StrCat(inheritor->name, ": inherited tile ", tile.tile, " with the state ",
                                                inheritor->inherited.at(tile.tile).sha256, ", but ", job.name, " has ",
                                                traced.state.sha256));
      }
      if (here) break;
      inheritor = &job;
      traced.made_by = InheritedFrom(chain, traced.made_by, tile.tile);
    }
    if (traced.made_by == chain.size()) {
      return absl::DataLossError(
          absl::StrCat(chain.back().name, ": inherited tile ", tile.tile, ", but has no base job"));
    }
    lineage.tiles.push_back(std::move(traced));
  }
  lineage.chain = std::move(chain);
  return lineage;
}

Status FillImages(const std::function<StatusOr<std::string>(const Digest&)>& read, int only, Lineage* lineage) {
  std::map<size_t, std::vector<TileLineage*>> of_maker;
  for (TileLineage& tile : lineage->tiles) {
    if (only < 0 || tile.tile.tile == only) of_maker[tile.made_by].push_back(&tile);
  }
  for (const auto& [maker, tiles] : of_maker) {
    const StatusOr<std::string> text = read(lineage->chain[maker].survey);
    if (absl::IsNotFound(text.status())) continue;
    TESSERA_RETURN_IF_ERROR(text.status());
    TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(*text));
    for (TileLineage* const tile : tiles) tile->images = ImagesOfTile(survey, tile->tile.core);
  }
  return absl::OkStatus();
}

}  // namespace tessera
