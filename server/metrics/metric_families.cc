#include "server/metrics/metric_families.h"

#include <prometheus/metric_family.h>

#include <algorithm>
#include <limits>
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

// Puts families together, each with all its values.
class FamilyList {
 public:
  // The family that Add and its like fill from now on.
  void Counter(const std::string& name, const std::string& help) { Begin(name, help, MetricType::Counter); }
  void Gauge(const std::string& name, const std::string& help) { Begin(name, help, MetricType::Gauge); }
  void Buckets(const std::string& name, const std::string& help) { Begin(name, help, MetricType::Histogram); }

  void Add(double value, Labels labels = {}) {
    ClientMetric metric;
    metric.label = std::move(labels);
    metric.counter.value = metric.gauge.value = value;  // whichever the family is of
    families_.back().metric.push_back(std::move(metric));
  }
  void Add(int64_t value, Labels labels = {}) { Add(static_cast<double>(value), std::move(labels)); }
  // `counts`: one more than bounds, not cumulative.
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
             "Tasks that wait for a worker, by kind and predicted memory, of jobs neither paused nor held");
  for (int kind = 0; kind < static_cast<int>(kTaskKindSlots); ++kind) {
    for (int memory_class = 0; memory_class <= kUnknownMemoryClass; ++memory_class) {
      const auto found = now.ready.find({kind, memory_class});
      list.Add(found == now.ready.end() ? int64_t{0} : found->second,
               {{"kind", std::string(KindName(kind))}, {"memory", MemoryName(memory_class)}});
    }
  }
  list.Gauge("oldest_ready_task_age_seconds", "How long the one of these that has waited longest has been ready");
  list.Add(now.oldest_ready_s);
  list.Gauge("tasks_delayed", "Tasks whose last attempt failed and that are tried again after a while");
  list.Add(now.delayed);
  list.Gauge("tasks_unfinished", "Tasks that have not succeeded, of jobs that have not ended, as far as planned");
  list.Add(now.unfinished);
  list.Gauge("leases", "Tasks that workers have now, by kind");
  for (size_t kind = 0; kind < kTaskKindSlots; ++kind)
    list.Add(now.leases[kind], {{"kind", std::string(KindName(kind))}});
  list.Gauge(
      "workers",
      "Workers: with a task, without one, set aside and given none for a while, or not heard of for a lease's time");
  list.Add(now.workers_working, {{"state", "working"}});
  list.Add(now.workers_idle, {{"state", "idle"}});
  list.Add(now.workers_suspended, {{"state", "set_aside"}});
  list.Add(now.workers_silent, {{"state", "silent"}});
  list.Gauge("jobs", "Jobs that have not ended");
  list.Add(now.jobs_queued, {{"state", "queued"}});
  list.Add(now.jobs_running, {{"state", "running"}});
  list.Add(now.jobs_paused, {{"state", "paused"}});
  list.Gauge("jobs_held", "Of these, jobs for whose results the disk has no room");
  list.Add(now.jobs_held);
}

void AddWork(const DispatchCounts& counts, FamilyList& list) {
  const auto of_kinds = [&](const auto& value) {
    for (size_t kind = 0; kind < kTaskKindSlots; ++kind) {
      list.Add(value(counts.kinds()[kind]), {{"kind", std::string(KindName(kind))}});
    }
  };
  list.Counter("attempts_started_total", "Leases granted");
  of_kinds([](const KindCounts& kind) { return kind.attempts; });
  list.Counter("attempts_failed_total", "Attempts that failed, by class of the error or because the lease expired");
  for (int i = static_cast<int>(ErrorClass::kInput); i <= static_cast<int>(ErrorClass::kInternal); ++i) {
    const auto found = counts.failures().find(static_cast<ErrorClass>(i));
    list.Add(found == counts.failures().end() ? int64_t{0} : found->second,
             {{"class", ClassName(static_cast<ErrorClass>(i))}});
  }
  list.Add(counts.leases_expired(), {{"class", "lease_expired"}});
  list.Counter("attempt_seconds_total", "Time between lease and end of the attempts that succeeded or failed");
  of_kinds([](const KindCounts& kind) { return kind.attempt_s; });
  list.Counter("tasks_succeeded_total", "Tasks that ran and succeeded");
  of_kinds([](const KindCounts& kind) { return kind.succeeded; });
  list.Counter("tasks_reused_total", "Tasks whose result was found stored");
  of_kinds([](const KindCounts& kind) { return kind.reused; });
  list.Counter("tasks_failed_total", "Tasks that failed for good");
  of_kinds([](const KindCounts& kind) { return kind.failed; });
  list.Counter("task_core_seconds_total", "Processor time of the tasks that ran and succeeded");
  of_kinds([](const KindCounts& kind) { return kind.core_s; });
  list.Counter("task_predicted_core_seconds_total", "What was predicted for the same tasks");
  of_kinds([](const KindCounts& kind) { return kind.predicted_core_s; });
  list.Counter("task_output_bytes_total", "Sizes of the outputs of the same tasks");
  of_kinds([](const KindCounts& kind) { return kind.output_bytes; });
  list.Buckets("task_core_seconds_ratio", "Processor time of tasks, used over predicted");
  of_kinds([](const KindCounts& kind) -> const Histogram& { return kind.core_ratio; });
  list.Buckets("task_memory_ratio", "Peak memory of tasks' workers, used over predicted");
  of_kinds([](const KindCounts& kind) -> const Histogram& { return kind.memory_ratio; });
  list.Counter("jobs_accepted_total", "Jobs accepted");
  list.Add(counts.jobs_accepted());
  list.Counter("jobs_ended_total", "Jobs that ended, by how");
  constexpr std::pair<JobState, const char*> kEnds[] = {{JobState::kSucceeded, "succeeded"},
                                                        {JobState::kPartial, "partial"},
                                                        {JobState::kFailed, "failed"},
                                                        {JobState::kCancelled, "cancelled"}};
  for (const auto& [state, name] : kEnds) {
    const auto found = counts.jobs_ended().find(state);
    list.Add(found == counts.jobs_ended().end() ? int64_t{0} : found->second, {{"state", name}});
  }
  list.Counter("tiles_set_aside_total", "Tiles that jobs went on without because a task of theirs failed for good");
  list.Add(counts.tiles_quarantined());
  list.Counter("workers_set_aside_total", "Times that a worker was set aside");
  list.Add(counts.workers_suspended());
  list.Counter("results_lost_total", "Stored results that were found lost or damaged and are made again");
  list.Add(counts.results_lost());
}

void AddStorage(const MetricSources& sources, const DispatchSnapshot& now, FamilyList& list) {
  list.Gauge("storage_ok", "1 while changes of state can be stored, 0 while they cannot and nothing is leased");
  list.Add(int64_t{now.can_store ? 1 : 0});
  list.Counter("journal_batches_total", "Batches of records stored");
  list.Add(now.journal.batches);
  list.Counter("journal_syncs_total", "Batches that were synced to the disk");
  list.Add(now.journal.syncs);
  list.Counter("journal_records_total", "Records stored");
  list.Add(now.journal.records);
  list.Counter("journal_failures_total", "Tries to store a batch that failed");
  list.Add(now.journal.failed);
  list.Gauge("journal_waiting_records", "Records that are not stored yet");
  list.Add(now.journal.waiting);
  list.Buckets("journal_batch_seconds", "Time that storing a batch took, sync included");
  list.Add(now.journal.seconds);
  list.Buckets("journal_batch_records", "Records of a batch");
  list.Add(now.journal.batch_records);
  list.Gauge("disk_free_bytes", "Room on the disk that holds the results");
  if (const auto free_bytes = sources.free_bytes ? sources.free_bytes() : std::nullopt) list.Add(*free_bytes);
}

void AddRpcs(const RpcCounts& rpcs, FamilyList& list) {
  list.Counter("blob_bytes_total", "Contents that went through the blob service: read by callers, or written");
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

}  // namespace

std::vector<MetricFamily> Families(const MetricSources& sources) {
  FamilyList list;
  list.Gauge("build_info", "1, with the version of the algorithms");
  list.Add(int64_t{1}, {{"algorithm_version", kAlgorithmVersion}});
  const DispatchSnapshot now = sources.dispatch();
  AddQueue(now, list);
  AddWork(now.counts, list);
  AddStorage(sources, now, list);
  if (sources.rpcs != nullptr) AddRpcs(*sources.rpcs, list);
  return list.Take();
}

}  // namespace tessera
