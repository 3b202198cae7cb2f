// State and blobs of one soaked cluster on servers: a schema in PostgreSQL, and a prefix in the bucket of an S3 store.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/s3/s3_client.h"
#include "server/store/postgres_connection.h"
#include "tests/e2e/programs.h"
#include "tests/soak/own_servers.h"

namespace tessera::soak {

class ServerStorage {
 public:
  // New and empty; the coordinator creates the schema. `folder`: for the file of credentials. The servers must run, and
  // outlive it.
  ServerStorage(OwnServers& servers, const std::string& folder, int number);
  // Removes schema and objects, as far as the servers can be reached.
  ~ServerStorage();
  ServerStorage(const ServerStorage&) = delete;
  ServerStorage& operator=(const ServerStorage&) = delete;

  OwnServers& servers() { return servers_; }
  // URL of the state.
  const std::string& state() const { return state_; }
  std::vector<std::string> CoordinatorArguments() const;
  // Only programs that `start` starts get the credentials of the store.
  void WithCredentials(const std::function<void()>& start) const;

  // Flips a bit of a stored blob, replaces the blob by its first half, or deletes it. `place`: in [0, 1), selects the
  // blob. Returns its key; empty if no blob was harmed. Spares the object by which coordinators recognise the store:
  // without it, tesserad --accept-blobs is needed.
  std::string HarmBlob(double place, e2e::Harm harm);
  // While the connection exists, nobody reads or writes the table of records. Null if it cannot be locked now.
  std::shared_ptr<PostgresConnection> LockRecords() const;
  // Writes the state as SQL to FOLDER/state.sql.
  void Dump(const std::string& folder) const;

 private:
  std::vector<std::string> Blobs() const;

  OwnServers& servers_;
  const std::string schema_, state_, credentials_file_;
  const S3Location location_;
  const SystemClock clock_;
  std::unique_ptr<S3CredentialsSource> credentials_;
  std::unique_ptr<S3Client> client_;
  std::string spared_;  // hash of the object; empty: not known yet
};

}  // namespace tessera::soak
