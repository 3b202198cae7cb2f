#include "server/fleet/ask_coordinator.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/client/connection.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {

CoordinatorLink::CoordinatorLink(const FleetFile& file, const Endpoint& endpoint) : file_(file), endpoint_(endpoint) {}
CoordinatorLink::~CoordinatorLink() = default;

StatusOr<CoordinatorView> CoordinatorLink::Ask() {
  if (connection_ == nullptr) {
    TESSERA_ASSIGN_OR_RETURN(connection_, Connection::Open(endpoint_));
  }
  auto view = AskConnected();
  if (!view.ok()) connection_.reset();
  return view;
}

StatusOr<CoordinatorView> CoordinatorLink::AskConnected() {
  v1::GetDemandRequest request;
  request.set_worth_s(file_.worth_s);
  for (const PilotClass& pilots : file_.classes) {
    v1::WorkerClass& asked = *request.add_classes();
    asked.set_memory_bytes(WorkerMemory_mib(pilots) << 20);
    asked.set_cores(pilots.cores);
    asked.set_time_limit_s(WorkerTime_s(pilots));
  }
  v1::GetDemandResponse demand;
  TESSERA_RETURN_IF_ERROR(connection_->GetDemand(request, &demand));
  v1::ListWorkersResponse workers;
  TESSERA_RETURN_IF_ERROR(connection_->ListWorkers(&workers));
  if (demand.demands_size() != request.classes_size()) {
    return absl::InternalError(
        absl::StrCat("the coordinator answered for ", demand.demands_size(), " classes of ", request.classes_size()));
  }
  CoordinatorView view;
  for (const v1::Demand& wanted : demand.demands()) view.demand.wanted.push_back(wanted.workers());
  for (const v1::UnfitTask& task : demand.unfit()) {
    view.demand.unfit.push_back({task.task(), task.title(), task.memory_bytes(), task.core_s()});
  }
  view.demand.unfit_count = demand.unfit_count();
  for (const v1::Worker& worker : workers.workers()) {
    view.workers.push_back({worker.name(),
                            worker.allocation(),
                            worker.memory_bytes(),
                            !worker.suspended_reason().empty(),
                            {worker.tasks().begin(), worker.tasks().end()}});
  }
  return view;
}

std::map<std::string, std::string> CoordinatorLink::Titles(const std::vector<std::string>& tasks) {
  std::set<std::string> jobs;
  for (const std::string& task : tasks) jobs.insert(task.substr(0, task.find("/tasks/")));
  std::map<std::string, std::string> titles;
  for (const std::string& job : jobs) {
    v1::ListTasksResponse listed;
    if (connection_ == nullptr || !connection_->ListTasks(job, &listed).ok()) continue;
    for (const v1::Task& task : listed.tasks()) titles[task.name()] = task.title();
  }
  return titles;
}

}  // namespace tessera
