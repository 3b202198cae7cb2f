#include "tests/soak/server_storage.h"

#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>

#include "common/storage/hash.h"
#include "server/store/state_store.h"
#include "tests/support/servers/test_s3.h"

namespace tessera::soak {
namespace {

constexpr double kLock_s = 1;        // limit of the wait for a lock
constexpr double kStatement_s = 30;  // of other statements
constexpr int64_t kMaxBlob_bytes = int64_t{1} << 30;

// The gateway is on this machine, and it runs: a request that fails twice fails the fault.
S3ClientOptions LocalOptions() {
  S3ClientOptions options;
  options.connect_s = 2;
  options.silence_s = 10;
  options.retry.max_attempts = 2;
  return options;
}

}  // namespace

ServerStorage::ServerStorage(OwnServers& servers, const std::string& folder, int number)
    : servers_(servers),
      schema_("soak_" + std::to_string(number)),
      state_(ServerAddress("postgres") + "?options=-csearch_path%3D" + schema_),
      credentials_file_(folder + "/credentials"),
      location_(NewTestLocation()),
      credentials_(FixedS3Credentials(TestCredentials())) {
  auto client = S3Client::Create(location_, credentials_.get(), &clock_, LocalOptions());
  if (!client.ok()) throw std::runtime_error(client.status().ToString());
  client_ = *std::move(client);
  const S3Credentials keys = TestCredentials();
  std::ofstream(credentials_file_) << "[default]\naws_access_key_id = " << keys.access_key
                                   << "\naws_secret_access_key = " << keys.secret_key << "\n";
  std::filesystem::permissions(credentials_file_, std::filesystem::perms::owner_read);
}

ServerStorage::~ServerStorage() {
  for (auto page = client_->List(""); page.ok() && !page->objects.empty(); page = client_->List("")) {
    std::vector<std::string> keys;
    for (const S3Object& object : page->objects) keys.push_back(object.key);
    if (!client_->Delete(keys).ok()) break;
  }
  const auto target = ParsePostgresUrl(state_);
  if (!target.ok()) return;
  const auto connection = PostgresConnection::Open(*target, kStatement_s);
  if (connection.ok()) (*connection)->Run("DROP SCHEMA IF EXISTS " + schema_ + " CASCADE").IgnoreError();
}

std::vector<std::string> ServerStorage::CoordinatorArguments() const {
  return {"--state", state_, "--blobs", ToText(location_), "--s3-endpoint", location_.endpoint};
}

void ServerStorage::WithCredentials(const std::function<void()>& start) const {
  ::setenv("AWS_SHARED_CREDENTIALS_FILE", credentials_file_.c_str(), 1);
  start();
  ::unsetenv("AWS_SHARED_CREDENTIALS_FILE");
}

std::vector<std::string> ServerStorage::Blobs() const {
  std::vector<std::string> keys;
  std::string next;
  do {
    const auto page = client_->List("blobs/", next);
    if (!page.ok()) return {};
    for (const S3Object& object : page->objects) {
      if (!object.key.ends_with(spared_)) keys.push_back(object.key);
    }
    next = page->next;
  } while (!next.empty());
  return keys;
}

std::string ServerStorage::HarmBlob(double place, e2e::Harm harm) {
  if (spared_.empty()) {
    const auto probe = ReadKept(state_, "blob_probe");
    if (!probe.ok() || !probe->has_value()) return "";
    spared_ = Sha256Hex(**probe);
  }
  const std::vector<std::string> keys = Blobs();
  if (keys.empty()) return "";
  const std::string& key = keys[static_cast<size_t>(place * static_cast<double>(keys.size()))];
  if (harm == e2e::Harm::kDelete) return client_->Delete({key}).ok() ? key : "";
  auto content = client_->Get(key, 0, kMaxBlob_bytes);
  if (!content.ok() || content->empty()) return "";
  const size_t half = content->size() / 2;
  if (harm == e2e::Harm::kFlip) {
    (*content)[half] = static_cast<char>((*content)[half] ^ 1);
  } else {
    content->resize(half);
  }
  return client_->Put(key, *content, Sha256Hex(*content)).ok() ? key : "";
}

std::shared_ptr<PostgresConnection> ServerStorage::LockRecords() const {
  const auto target = ParsePostgresUrl(state_);
  if (!target.ok()) return nullptr;
  auto connection = PostgresConnection::Open(*target, kLock_s);
  if (!connection.ok() || !(*connection)->Run("BEGIN; LOCK TABLE records").ok()) return nullptr;
  return *std::move(connection);
}

void ServerStorage::Dump(const std::string& folder) const {
  servers_.Restore();
  e2e::Program(folder, "/usr/lib/postgresql/15/bin/pg_dump",
               {"--schema", schema_, "--file", folder + "/state.sql", ServerAddress("postgres")})
      .Wait();
}

}  // namespace tessera::soak
