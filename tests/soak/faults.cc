#include "tests/soak/faults.h"

#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <utility>

#include "tests/e2e/namespaces.h"

namespace tessera::soak {
namespace {

namespace fs = std::filesystem;
using e2e::TcpProxy;

}  // namespace

Faults::Faults(SoakedCluster& cluster, bool disks, uint64_t seed, History& history, std::map<std::string, int>& counts)
    : cluster_(cluster), history_(history), counts_(counts), seed_(seed) {
  const auto network = [this](int worker) -> TcpProxy& { return *cluster_.workers()[worker].network; };
  const auto away = [this, network](TcpProxy::Mode mode) {
    const int worker = Any();
    network(worker).Set(mode);
    return Until(Pause_s(), [network, worker] { network(worker).Set(TcpProxy::Mode::kPass); });
  };
  // On servers, a coordinator that was killed is away for longer: 6 s.
  const bool on_servers = cluster_.storage() != nullptr;
  kinds_ = {
      {"worker killed", 3, [this] { return cluster_.EndWorker(Any(), true, random_.Uniform(0, 4)); }},
      {"worker drained", 2, [this] { return cluster_.EndWorker(Any(), false, random_.Uniform(0, 4)); }},
      {"worker stands still", 3,
       [this] {
         const int worker = Any();
         cluster_.StopWorker(worker, true);
         return Until(Pause_s(), [this, worker] { cluster_.StopWorker(worker, false); });
       }},
      {"coordinator killed", on_servers ? 1.0 : 2.0,
       [this] { return cluster_.EndCoordinator(true, random_.Uniform(0, 3)); }},
      {"coordinator ended", 1, [this] { return cluster_.EndCoordinator(false, random_.Uniform(0, 3)); }},
      {"coordinator stands still", 1,
       [this] {
         if (cluster_.coordinator_stopped()) return false;
         cluster_.StopCoordinator(true);
         return Until(Pause_s(), [this] { cluster_.StopCoordinator(false); });
       }},
      {"network slow", 1,
       [this, network] {
         const int worker = Any();
         network(worker).SetDelay(random_.Uniform(0.01, 0.3));
         return Until(random_.Uniform(1, 6), [network, worker] { network(worker).SetDelay(0); });
       }},
      {"network silent", 2, [away] { return away(TcpProxy::Mode::kStall); }},
      {"network cut", 2, [away] { return away(TcpProxy::Mode::kCut); }},
      {"connections reset", 2,
       [this, network] {
         network(Any()).Drop();
         return true;
       }},
      {"database locked", 1, [this] { return LockDatabase(); }},
      {"stored file harmed", on_servers ? 9.0 : 5.0, [this] { return HarmBlob(); }},
      {"scratch folder gone", 1, [this] { return TakeScratch(); }},
  };
  if (disks) kinds_.push_back({"disk full", 3, [this] { return FillDisk(); }});
  if (cluster_.storage() != nullptr) AddServerKinds();
}

void Faults::AddServerKinds() {
  kinds_.push_back({"database killed", 2, [this] { return KillServer(Server::kPostgres); }});
  kinds_.push_back({"S3 gateway killed", 2, [this] { return KillServer(Server::kGateway); }});
  kinds_.push_back({"S3 gateway stands still", 2, [this] { return SuspendGateway(); }});
}

int Faults::Any() {
  const int worker = static_cast<int>(random_.Below(static_cast<int64_t>(cluster_.workers().size())));
  what_ += ", worker " + std::to_string(worker);
  return worker;
}

double Faults::Pause_s() {
  return SoakedCluster::kLease_s * (random_.Below(2) == 0 ? random_.Uniform(0.1, 0.8) : random_.Uniform(1.1, 2.5));
}

bool Faults::Until(double for_s, std::function<void()> lift) {
  what_ += ", for " + std::to_string(for_s) + " s";
  lifts_.emplace(history_.Now_s() + for_s, std::move(lift));
  return true;
}

void Faults::Strike() {
  random_ = RandomOf(seed_, 'f', strikes_++);
  double sum = 0;
  for (const Kind& kind : kinds_) sum += kind.weight;
  double at = random_.Uniform(0, sum);
  const Kind* chosen = &kinds_.back();
  for (const Kind& kind : kinds_) {
    if (at < kind.weight) {
      chosen = &kind;
      break;
    }
    at -= kind.weight;
  }
  what_ = chosen->name;
  if (!chosen->begin()) return;
  ++counts_[chosen->name];
  history_.Note(what_);
}

void Faults::Lift() {
  while (!lifts_.empty() && lifts_.begin()->first <= history_.Now_s()) {
    const auto lift = std::move(lifts_.begin()->second);
    lifts_.erase(lifts_.begin());
    lift();
  }
  LookAtServers();
}

void Faults::LiftAll() {
  for (const auto& [when, lift] : std::exchange(lifts_, {})) lift();
  if (cluster_.storage() != nullptr) cluster_.storage()->servers().Restore();
  LookAtServers();
  cluster_.LiftAll();
}

bool Faults::KillServer(Server server) {
  if (!away_.emplace(server, 1).second) return false;
  cluster_.AddHarmOfState(1);
  if (server == Server::kPostgres) cluster_.SetDatabaseAway(true);
  cluster_.storage()->servers().Kill(server);
  return Until(random_.Uniform(0, 3), [this, server] { cluster_.storage()->servers().StartAgain(server); });
}

bool Faults::SuspendGateway() {
  if (!away_.emplace(Server::kGateway, 0).second) return false;  // a coordinator that starts waits for it
  cluster_.storage()->servers().SuspendGateway(true);
  return Until(random_.Uniform(0.5, 6), [this] { cluster_.storage()->servers().SuspendGateway(false); });
}

void Faults::LookAtServers() {
  std::erase_if(away_, [this](const auto& entry) {
    const auto& [server, harms] = entry;
    if (!cluster_.storage()->servers().Serves(server)) return false;
    cluster_.AddHarmOfState(-harms);
    if (server == Server::kPostgres) cluster_.SetDatabaseAway(false);
    return true;
  });
}

bool Faults::LockRecords() {
  if (away_.contains(Server::kPostgres)) return false;
  const double for_s = random_.Uniform(0.3, 2.8);
  auto lock = cluster_.storage()->LockRecords();
  if (lock == nullptr) return false;
  database_locked_ = true;
  cluster_.AddHarmOfState(1);
  return Until(for_s, [this, lock]() mutable {
    lock.reset();
    database_locked_ = false;
    cluster_.AddHarmOfState(-1);
  });
}

bool Faults::LockDatabase() {
  if (database_locked_) return false;
  if (cluster_.storage() != nullptr) return LockRecords();
  sqlite3* opened = nullptr;
  sqlite3_open_v2((cluster_.data() + "/state.sqlite").c_str(), &opened, SQLITE_OPEN_READWRITE, nullptr);
  const std::shared_ptr<sqlite3> db(opened, sqlite3_close);
  sqlite3_busy_timeout(db.get(), 1000);
  if (sqlite3_exec(db.get(), "BEGIN IMMEDIATE", nullptr, nullptr, nullptr) != SQLITE_OK) {
    return false;
  }
  database_locked_ = true;
  cluster_.AddHarmOfState(1);
  return Until(random_.Uniform(0.5, 6), [this, db] {
    sqlite3_exec(db.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    database_locked_ = false;
    cluster_.AddHarmOfState(-1);
  });
}

bool Faults::FillDisk() {
  int64_t which = random_.Below(3);
  if (which == 1 && cluster_.storage() != nullptr) which = 2;  // no blobs are in the folder
  const double for_s = random_.Uniform(0.5, 6);
  const int worker = which == 2 ? Any() : -1;
  const std::string disk = which == 0   ? cluster_.data()
                           : which == 1 ? cluster_.data() + "/blobs"
                                        : cluster_.workers()[worker].scratch;
  what_ += ": " + disk;
  if (!harmed_.insert(disk).second) return false;
  const auto full = std::make_shared<e2e::FullDisk>(disk);
  if (worker < 0) cluster_.AddHarmOfState(1);
  if (worker >= 0) cluster_.HarmScratch(worker, true);
  return Until(for_s, [this, full, disk, worker] {
    harmed_.erase(disk);
    if (worker < 0) cluster_.AddHarmOfState(-1);
    if (worker >= 0) cluster_.HarmScratch(worker, false);
  });
}

bool Faults::HarmBlob() {
  std::vector<std::string> folders = {cluster_.data() + "/blobs"};
  for (const SoakedCluster::Worker& worker : cluster_.workers()) folders.push_back(worker.scratch + "/cache");
  // Mostly of the coordinator's: a worker's cache is of little use to others.
  const size_t folder =
      random_.Below(3) > 0 ? 0 : static_cast<size_t>(random_.Below(static_cast<int64_t>(folders.size())));
  const double place = random_.Uniform();
  const auto harm = static_cast<e2e::Harm>(random_.Below(3));
  static constexpr const char* kHow[] = {"flipped", "cut", "deleted"};
  if (folder == 0 && cluster_.storage() != nullptr) {
    if (away_.contains(Server::kGateway)) return false;
    const std::string blob = cluster_.storage()->HarmBlob(place, harm);
    what_ += std::string(", ") + kHow[static_cast<int>(harm)] + ": " + blob;
    return !blob.empty();
  }
  std::error_code gone;
  if (!fs::exists(folders[folder], gone)) return false;
  try {  // files come and go meanwhile
    const std::vector<std::string> blobs = e2e::BlobsIn(folders[folder]);
    if (blobs.empty()) return false;
    const std::string& blob = blobs[static_cast<size_t>(place * static_cast<double>(blobs.size()))];
    what_ += std::string(", ") + kHow[static_cast<int>(harm)] + ": " + blob;
    e2e::HarmFile(blob, harm);
    return true;
  } catch (const fs::filesystem_error&) {
    return false;
  }
}

bool Faults::TakeScratch() {
  const int worker = Any();
  const std::string& scratch = cluster_.workers()[worker].scratch;
  const std::string tasks = scratch + "/tasks", away = scratch + "/tasks.away";
  const double for_s = random_.Uniform(0.5, 6);
  if (!fs::is_directory(tasks) || !harmed_.insert(scratch).second) return false;
  fs::rename(tasks, away);
  std::ofstream(tasks).put('x');
  cluster_.HarmScratch(worker, true);
  return Until(for_s, [this, worker, scratch, tasks, away] {
    std::error_code failed;
    if (fs::is_regular_file(tasks)) {
      fs::remove(tasks, failed);
      fs::rename(away, tasks, failed);
    }
    fs::remove_all(away, failed);  // a worker that was started meanwhile has made another
    harmed_.erase(scratch);
    cluster_.HarmScratch(worker, false);
  });
}

}  // namespace tessera::soak
