// The gRPC services. Each method converts the request, calls the coordinator and converts the answer. Include in .cc
// files only.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/admission/admission.h"
#include "server/auth/client_limits.h"
#include "server/grpc/coordinator_server.h"
#include "server/grpc/job_watches.h"
#include "server/tiles/tiles.h"
#include "tessera/v1/blobs.grpc.pb.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/workers.grpc.pb.h"

namespace tessera {

// Watches use no thread each and share serialized messages.
class JobsService final : public v1::Jobs::WithRawCallbackMethod_WatchJob<v1::Jobs::Service> {
 public:
  JobsService(const ServerEnvironment& environment, ClientLimits& limits, DispatchCore& core, Jobs& jobs)
      : environment_(environment),
        core_(core),
        jobs_(jobs),
        tiles_(core, environment.coordinator->planning()),
        admission_(AdmissionEnvironment{&jobs, &limits, environment.digests, environment.clock, environment.read_scene,
                                        environment.scene_files, environment.scenes_over_network,
                                        environment.stored_scenes, environment.blobs}),
        watches_(core, jobs, environment.access, &limits) {}
  grpc::Status CreateJob(grpc::ServerContext* context, const v1::CreateJobRequest* request, v1::Job* response) override;
  grpc::Status ExportJob(grpc::ServerContext* context, const v1::ExportJobRequest* request, v1::Job* response) override;
  grpc::Status GetJob(grpc::ServerContext* context, const v1::GetJobRequest* request, v1::Job* response) override;
  grpc::Status ListJobs(grpc::ServerContext* context, const v1::ListJobsRequest* request,
                        v1::ListJobsResponse* response) override;
  grpc::Status CancelJob(grpc::ServerContext* context, const v1::CancelJobRequest* request, v1::Job* response) override;
  grpc::Status ChangeJob(grpc::ServerContext* context, const v1::ChangeJobRequest* request, v1::Job* response) override;
  grpc::Status RetryJob(grpc::ServerContext* context, const v1::RetryJobRequest* request, v1::Job* response) override;
  grpc::Status DeleteJob(grpc::ServerContext* context, const v1::DeleteJobRequest* request,
                         v1::DeleteJobResponse* response) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* WatchJob(grpc::CallbackServerContext* context,
                                                       const grpc::ByteBuffer* request) override {
    return watches_.Watch(context, *request);
  }
  JobWatches& watches() { return watches_; }
  grpc::Status ListTasks(grpc::ServerContext* context, const v1::ListTasksRequest* request,
                         v1::ListTasksResponse* response) override;
  grpc::Status ListAttempts(grpc::ServerContext* context, const v1::ListAttemptsRequest* request,
                            v1::ListAttemptsResponse* response) override;
  grpc::Status ListTiles(grpc::ServerContext* context, const v1::ListTilesRequest* request,
                         v1::ListTilesResponse* response) override;
  grpc::Status ListViews(grpc::ServerContext* context, const v1::ListViewsRequest* request,
                         v1::ListViewsResponse* response) override;
  grpc::Status LocatePoint(grpc::ServerContext* context, const v1::LocatePointRequest* request,
                           v1::LocatePointResponse* response) override;
  grpc::Status ListArtifacts(grpc::ServerContext* context, const v1::ListArtifactsRequest* request,
                             v1::ListArtifactsResponse* response) override;
  grpc::Status ListSettings(grpc::ServerContext* context, const v1::ListSettingsRequest* request,
                            v1::ListSettingsResponse* response) override;
  grpc::Status QuoteJob(grpc::ServerContext* context, const v1::CreateJobRequest* request,
                        v1::Quote* response) override;

 private:
  const ServerEnvironment& environment_;
  DispatchCore& core_;
  Jobs& jobs_;
  Tiles tiles_;
  const Admission admission_;
  JobWatches watches_;
};

// Calls that wait for a task or for durability use no thread.
class WorkersService final : public v1::Workers::CallbackService {
 public:
  using Context = grpc::CallbackServerContext;
  using Reactor = grpc::ServerUnaryReactor;

  WorkersService(const ServerEnvironment& environment, DispatchCore& core, Leases& leases)
      : environment_(environment), lease_s_(core.options().lease_s), core_(core), leases_(leases) {}
  Reactor* RegisterWorker(Context* context, const v1::RegisterWorkerRequest* request,
                          v1::RegisterWorkerResponse* response) override;
  Reactor* LeaseTask(Context* context, const v1::LeaseTaskRequest* request, v1::LeaseTaskResponse* response) override;
  Reactor* Heartbeat(Context* context, const v1::HeartbeatRequest* request, v1::HeartbeatResponse* response) override;
  Reactor* ReportTask(Context* context, const v1::ReportTaskRequest* request,
                      v1::ReportTaskResponse* response) override;
  Reactor* UnregisterWorker(Context* context, const v1::UnregisterWorkerRequest* request,
                            v1::UnregisterWorkerResponse* response) override;
  Reactor* ListWorkers(Context* context, const v1::ListWorkersRequest* request,
                       v1::ListWorkersResponse* response) override;
  Reactor* GetDemand(Context* context, const v1::GetDemandRequest* request, v1::GetDemandResponse* response) override;

 private:
  // Refusal::kUnknownWorker unless the caller has the worker's secret.
  Status Refused(const Context& context, const std::string& worker) const;

  const ServerEnvironment& environment_;
  const double lease_s_;
  DispatchCore& core_;
  Leases& leases_;
};

class BlobsService final : public v1::Blobs::Service {
 public:
  BlobsService(const ServerEnvironment& environment, ClientLimits& limits, Coordinator& coordinator)
      : environment_(environment),
        limits_(limits),
        core_(coordinator.core()),
        jobs_(coordinator.jobs()),
        leases_(coordinator.leases()),
        recovery_(coordinator.recovery()) {}
  grpc::Status StatBlobs(grpc::ServerContext* context, const v1::StatBlobsRequest* request,
                         v1::StatBlobsResponse* response) override;
  grpc::Status ReadBlob(grpc::ServerContext* context, const v1::ReadBlobRequest* request,
                        grpc::ServerWriter<v1::BlobChunk>* writer) override;
  grpc::Status WriteBlob(grpc::ServerContext* context, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                         v1::WriteBlobResponse* response) override;
  grpc::Status QueryWrite(grpc::ServerContext* context, const v1::QueryWriteRequest* request,
                          v1::QueryWriteResponse* response) override;
  grpc::Status GetTransfers(grpc::ServerContext* context, const v1::GetTransfersRequest* request,
                            v1::GetTransfersResponse* response) override;
  grpc::Status CompleteTransfer(grpc::ServerContext* context, const v1::CompleteTransferRequest* request,
                                v1::CompleteTransferResponse* response) override;

 private:
  // Blobs that a worker may read; cached while its leases do not change.
  struct Inputs {
    std::vector<std::pair<std::string, int>> leases;
    std::set<std::string> sha256;
  };

  // Blob authorization: workers read the inputs of their leases, viewers and submitters published results, admins
  // everything. PERMISSION_DENIED, whether or not the blob exists.
  Status MayRead(const Caller& caller, const Digest& digest) const;
  bool IsInput(const std::string& worker, const Digest& digest) const;
  // OK for a worker that has a lease.
  Status MayWrite(const Caller& caller) const;
  // Access to a blob's bytes, in the blob store or in a scene.
  struct Source {
    std::string name;  // for messages
    std::function<StatusOr<std::string>(int64_t offset_bytes, int64_t size_bytes)> read;
  };
  // The blob or, for workers, a scene file with this content.
  StatusOr<Source> Locate(const Caller& caller, const Digest& digest) const;
  // A file of a scene in an object store. FAILED_PRECONDITION if it has another size.
  StatusOr<Source> LocateInStore(const std::string& url, const Digest& digest) const;
  // Waits until a published file is recomputed. NOT_FOUND if no job published it; UNAVAILABLE after kAwaitRemakeS.
  Status AwaitRemake(const Digest& digest, const grpc::ServerContext& context) const;
  // Hashes the stored blob, quarantines a damaged one, and waits until a published file is recomputed. Errors as of
  // AwaitRemake.
  Status CheckStored(const Caller& caller, const Digest& digest, grpc::ServerContext& context);
  // DATA_LOSS with the message `what`. Recomputes the blob if a job published it.
  Status Damaged(const Digest& digest, const std::string& what) const;

  // The signed requests for one content. `request`: with the hashes of the parts, if any.
  StatusOr<v1::Transfer> TransferOf(const Caller& caller, const Digest& digest,
                                    const v1::GetTransfersRequest& request) const;
  // The same to read a file of a scene in an object store, which is one of `urls`. `check`: of those, the first whose
  // content is right; NOT_FOUND if there is none.
  StatusOr<v1::Transfer> TransferOfSceneFile(const Caller& caller, const Digest& digest,
                                             const std::vector<std::string>& urls, bool check) const;
  // Places of scene files with this content in an object store that the caller may read.
  std::vector<std::string> StoredSceneFiles(const Caller& caller, const Digest& digest) const;

  const ServerEnvironment& environment_;
  ClientLimits& limits_;
  const DispatchCore& core_;
  const Jobs& jobs_;
  const Leases& leases_;
  Recovery& recovery_;
  mutable std::mutex mutex_;                      // of `inputs_`
  mutable std::map<std::string, Inputs> inputs_;  // by worker
};

}  // namespace tessera
