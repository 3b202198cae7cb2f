#include "server/metrics/metric_families.h"

#include <prometheus/metric_family.h>

#include <algorithm>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <utility>

#include "common/base/version.h"

namespace tessera {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

// Builds a list of metric families with their values.
class FamilyList {
 public:
  // Each begins a family with the value, if given; the following Add calls add further values.
  template <class... Value>
  void Counter(const std::string& name, const std::string& help, const Value&... value) {
    Begin(name, help, MetricType::Counter);
    (Add(value), ...);
  }
  template <class... Value>
  void Gauge(const std::string& name, const std::string& help, const Value&... value) {
    Begin(name, help, MetricType::Gauge);
    (Add(value), ...);
  }
  template <class... Value>
  void Buckets(const std::string& name, const std::string& help, const Value&... value) {
    Begin(name, help, MetricType::Histogram);
    (Add(value), ...);
  }

  void Add(double value, Labels labels = {}) {
    ClientMetric metric;
    metric.label = std::move(labels);
    metric.counter.value = metric.gauge.value = value;  // the family's type decides which is used
    families_.back().metric.push_back(std::move(metric));
  }
  void Add(int64_t value, Labels labels = {}) { Add(static_cast<double>(value), std::move(labels)); }
  // `counts`: bounds.size() + 1 values, not cumulative.
  void Add(std::span<const double> bounds, const std::vector<int64_t>& counts, double sum, Labels labels = {}) {
    ClientMetric metric;
    metric.label = std::move(labels);
    uint64_t cumulative = 0;
    for (size_t i = 0; i < counts.size(); ++i) {
      cumulative += static_cast<uint64_t>(counts[i]);
      const double bound = i < bounds.size() ? bounds[i] : std::numeric_limits<double>::infinity();
      metric.histogram.bucket.push_back({cumulative, bound});
    }
    metric.histogram.sample_count = cumulative;
    metric.histogram.sample_sum = sum;
    families_.back().metric.push_back(std::move(metric));
  }
  void Add(const Histogram& histogram, Labels labels = {}) {
    Add(histogram.bounds(), histogram.counts(), histogram.sum(), std::move(labels));
  }

  std::vector<MetricFamily> Take() { return std::move(families_); }

 private:
  void Begin(const std::string& name, const std::string& help, MetricType type) {
    families_.push_back({"tessera_" + name, help, type, {}});
  }
  std::vector<MetricFamily> families_;
};

std::string MemoryName(int memory_class) {
  if (memory_class == kUnknownMemoryClass) return "unknown";
  if (memory_class == static_cast<int>(kMemoryClasses_GiB.size())) return "more";
  return std::to_string(kMemoryClasses_GiB[memory_class]) + "GiB";
}

std::string ClassName(ErrorClass error_class) {
  std::string name = ErrorClassName(error_class);
  std::replace(name.begin(), name.end(), ' ', '_');
  return name;
}

void AddQueue(const DispatchSnapshot& now, FamilyList& list) {
  list.Gauge("tasks_ready",
             "Tasks that wait for a worker, by kind and predicted memory, of jobs that are neither paused nor held");
  for (int kind = 0; kind < static_cast<int>(kTaskKindSlots); ++kind) {
    for (int memory_class = 0; memory_class <= kUnknownMemoryClass; ++memory_class) {
      const auto found = now.ready.find({kind, memory_class});
      list.Add(found == now.ready.end() ? int64_t{0} : found->second,
               {{"kind", std::string(KindName(kind))}, {"memory", MemoryName(memory_class)}});
    }
  }
  list.Gauge("workers_wanted",
             "Workers of one core that would have 300 s of work each, for the tasks of this class of predicted memory "
             "and of all larger classes together; for programs that start workers");
  for (size_t i = 0; i < now.wanted.size(); ++i) {
    list.Add(int64_t{now.wanted[i].workers}, {{"memory", MemoryName(static_cast<int>(i))}});
  }
  list.Gauge("oldest_ready_task_age_seconds", "Time since the oldest task of tasks_ready became ready, seconds",
             now.oldest_ready_s);
  list.Gauge("tasks_delayed", "Tasks that wait for their retry after a failed attempt", now.delayed);
  list.Gauge("tasks_unfinished", "Planned tasks that have not succeeded, of jobs that have not ended", now.unfinished);
  list.Gauge("leases", "Tasks that are leased to workers, by kind");
  for (size_t kind = 0; kind < kTaskKindSlots; ++kind)
    list.Add(now.leases[kind], {{"kind", std::string(KindName(kind))}});
  list.Gauge("workers",
             "Workers by state: working (has a task), idle, suspended (gets no task for a while), silent (no heartbeat "
             "for a lease's time)");
  list.Add(now.workers_working, {{"state", "working"}});
  list.Add(now.workers_idle, {{"state", "idle"}});
  list.Add(now.workers_suspended, {{"state", "suspended"}});
  list.Add(now.workers_silent, {{"state", "silent"}});
  list.Gauge("jobs", "Jobs that have not ended");
  list.Add(now.jobs_queued, {{"state", "queued"}});
  list.Add(now.jobs_running, {{"state", "running"}});
  list.Add(now.jobs_paused, {{"state", "paused"}});
  list.Gauge("jobs_held", "Jobs that wait because the disk has no room for their results", now.jobs_held);
}

void AddWork(const DispatchCounts& counts, FamilyList& list) {
  // Adds the values of all kinds.
  const auto of_kinds = [&](auto value) {
    for (size_t kind = 0; kind < kTaskKindSlots; ++kind) {
      list.Add(counts.kinds()[kind].*value, {{"kind", std::string(KindName(kind))}});
    }
  };
  const auto count_kinds = [&](const char* name, const char* help, auto value) {
    list.Counter(name, help);
    of_kinds(value);
  };
  count_kinds("attempts_started_total", "Leases granted", &KindCounts::attempts);
  list.Counter("attempts_failed_total", "Attempts that failed, by class of the error or because the lease expired");
  for (int i = static_cast<int>(ErrorClass::kInput); i <= static_cast<int>(ErrorClass::kInternal); ++i) {
    const auto found = counts.failures().find(static_cast<ErrorClass>(i));
    list.Add(found == counts.failures().end() ? int64_t{0} : found->second,
             {{"class", ClassName(static_cast<ErrorClass>(i))}});
  }
  list.Add(counts.leases_expired(), {{"class", "lease_expired"}});
  count_kinds("attempt_seconds_total", "Time between lease and end of the attempts that succeeded or failed",
              &KindCounts::attempt_s);
  count_kinds("tasks_succeeded_total", "Tasks that ran and succeeded", &KindCounts::succeeded);
  count_kinds("tasks_reused_total", "Tasks whose stored result was reused", &KindCounts::reused);
  count_kinds("tasks_failed_total", "Tasks that failed permanently", &KindCounts::failed);
  count_kinds("task_core_seconds_total", "Processor time of the tasks that ran and succeeded", &KindCounts::core_s);
  count_kinds("task_predicted_core_seconds_total", "Predicted processor time of the same tasks",
              &KindCounts::predicted_core_s);
  count_kinds("task_output_bytes_total", "Sizes of the outputs of the same tasks", &KindCounts::output_bytes);
  list.Buckets("task_core_seconds_ratio", "Ratio of used to predicted processor time of tasks");
  of_kinds(&KindCounts::core_ratio);
  list.Buckets("task_memory_ratio", "Ratio of used to predicted peak memory of tasks");
  of_kinds(&KindCounts::memory_ratio);
  list.Counter("jobs_accepted_total", "Jobs accepted", counts.jobs_accepted());
  list.Counter("jobs_ended_total", "Jobs that ended, by final state");
  constexpr std::pair<JobState, const char*> kEnds[] = {{JobState::kSucceeded, "succeeded"},
                                                        {JobState::kPartial, "partial"},
                                                        {JobState::kFailed, "failed"},
                                                        {JobState::kCancelled, "cancelled"}};
  for (const auto& [state, name] : kEnds) {
    const auto found = counts.jobs_ended().find(state);
    list.Add(found == counts.jobs_ended().end() ? int64_t{0} : found->second, {{"state", name}});
  }
  list.Counter("tiles_quarantined_total", "Tiles that were quarantined because one of their tasks failed permanently",
               counts.tiles_quarantined());
  list.Counter("workers_suspended_total", "Suspensions of workers", counts.workers_suspended());
  list.Counter("results_lost_total", "Stored results that were found lost or damaged and are computed again",
               counts.results_lost());
}

void AddStorage(const MetricSources& sources, const DispatchSnapshot& now, FamilyList& list) {
  list.Gauge("storage_ok", "1 while the journal accepts records; 0 while writes fail and leasing is suspended",
             int64_t{now.can_store ? 1 : 0});
  list.Counter("journal_batches_total", "Batches of records stored", now.journal.batches);
  list.Counter("journal_syncs_total", "Batches that were synced to the disk", now.journal.syncs);
  list.Counter("journal_records_total", "Records stored", now.journal.records);
  list.Counter("journal_failures_total", "Failed attempts to store a batch", now.journal.failed);
  list.Gauge("journal_waiting_records", "Records that are not stored yet", now.journal.waiting);
  list.Buckets("journal_batch_seconds", "Time to store a batch, including the sync", now.journal.seconds);
  list.Buckets("journal_batch_records", "Number of records per batch", now.journal.batch_records);
  list.Gauge("disk_free_bytes", "Free space on the disk that holds the results");
  if (const auto free_bytes = sources.free_bytes ? sources.free_bytes() : std::nullopt) list.Add(*free_bytes);
}

// Requests of this process: those of workers and clients by signed URLs are not counted.
void AddStore(const std::map<std::string, S3Counts>& counts, FamilyList& list) {
  const auto of_methods = [&](const char* name, const char* help, auto value) {
    list.Counter(name, help);
    for (const char* method : {"copy", "delete", "get", "head", "list", "put", "upload"}) {
      const auto found = counts.find(method);
      list.Add(found == counts.end() ? S3Counts().*value : found->second.*value, {{"method", method}});
    }
  };
  of_methods("store_requests_total", "Requests to the object store, including repeated ones", &S3Counts::calls);
  of_methods("store_retries_total", "Requests to the object store that were repeated", &S3Counts::retries);
  of_methods("store_errors_total", "Requests to the object store that failed after all repeats", &S3Counts::errors);
  of_methods("store_seconds_total", "Time of all requests to the object store", &S3Counts::seconds);
  of_methods("store_sent_bytes_total", "Bytes sent to the object store", &S3Counts::sent_bytes);
  of_methods("store_received_bytes_total", "Bytes received from the object store", &S3Counts::received_bytes);
}

void AddRpcs(const RpcCounts& rpcs, FamilyList& list) {
  list.Counter("blob_bytes_total", "Bytes transferred through the blob service, by direction");
  list.Add(rpcs.blob_bytes_read(), {{"direction", "read"}});
  list.Add(rpcs.blob_bytes_written(), {{"direction", "written"}});
  list.Counter("rpcs_total", "Calls answered, by method and code");
  for (const auto& method : rpcs.methods()) {
    for (int code = 0; code < RpcCounts::kCodes; ++code) {
      const int64_t calls = method->codes[code];
      if (code == 0 || calls > 0) list.Add(calls, {{"method", method->name}, {"code", RpcCounts::CodeName(code)}});
    }
  }
  list.Buckets("rpc_seconds", "Time from a call's arrival to its answer; LeaseTask and WatchJob wait by design");
  for (const auto& method : rpcs.methods()) {
    const std::vector<int64_t> counts(method->buckets.begin(), method->buckets.end());
    list.Add(RpcCounts::kBounds_s, counts, method->seconds, {{"method", method->name}});
  }
}

void AddHttp(const HttpCounts& http, FamilyList& list) {
  list.Counter("http_requests_total", "Requests to the page's HTTP server answered, by route and class of status");
  for (const auto& route : http.routes()) {
    for (int i = 0; i < HttpCounts::kClasses; ++i) {
      const int64_t requests = route->classes[i];
      const std::string status = std::to_string(i + 1) + "xx";
      if (status == "2xx" || requests > 0) list.Add(requests, {{"route", route->name}, {"status", status}});
    }
  }
  list.Buckets("http_request_seconds", "Time from a whole request to its answer, without sending it");
  for (const auto& route : http.routes()) {
    const std::vector<int64_t> counts(route->buckets.begin(), route->buckets.end());
    list.Add(HttpCounts::kBounds_s, counts, route->seconds, {{"route", route->name}});
  }
}

}  // namespace

std::vector<MetricFamily> Families(const MetricSources& sources) {
  FamilyList list;
  list.Gauge("build_info", "1, with the version of the algorithms");
  list.Add(int64_t{1}, {{"algorithm_version", kAlgorithmVersion}});
  const bool active = static_cast<bool>(sources.dispatch);
  list.Gauge("coordinator_active", "1 while the coordinator serves, 0 while it stands by for another one",
             int64_t{active ? 1 : 0});
  if (!active) return list.Take();
  const DispatchSnapshot now = sources.dispatch();
  AddQueue(now, list);
  AddWork(now.counts, list);
  AddStorage(sources, now, list);
  AddStore(sources.store ? sources.store() : std::map<std::string, S3Counts>(), list);
  if (sources.rpcs != nullptr) AddRpcs(*sources.rpcs, list);
  if (sources.http != nullptr) AddHttp(*sources.http, list);
  return list.Take();
}

}  // namespace tessera
