// Access control: calls every method with every role and with invalid credentials.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>

#include <set>

#include "common/access/certificates.h"
#include "common/access/secrets.h"
#include "common/access/tokens.h"
#include "common/base/refusal.h"
#include "common/rpc/status_conversion.h"
#include "tests/support/signing_transfers.h"
#include "tests/unit/server/grpc/raw_call.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;
using Metadata = CallMetadata;

constexpr const char* kRoleNames[] = {"viewer", "submitter", "worker", "admin"};

// Roles that may call each method. A served method without a row fails the test.
const std::map<std::string, std::set<std::string>> kMayCall = {
    {"/tessera.v1.Jobs/CreateJob", {"submitter", "admin"}},
    {"/tessera.v1.Jobs/ExportJob", {"submitter", "admin"}},
    {"/tessera.v1.Jobs/GetJob", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListJobs", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/CancelJob", {"submitter", "admin"}},
    {"/tessera.v1.Jobs/ChangeJob", {"submitter", "admin"}},
    {"/tessera.v1.Jobs/RetryJob", {"submitter", "admin"}},
    {"/tessera.v1.Jobs/DeleteJob", {"admin"}},
    {"/tessera.v1.Jobs/WatchJob", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListTasks", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListAttempts", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListTiles", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListViews", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/LocatePoint", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListArtifacts", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/ListSettings", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Jobs/QuoteJob", {"submitter", "admin"}},
    {"/tessera.v1.Workers/RegisterWorker", {"worker"}},
    {"/tessera.v1.Workers/LeaseTask", {"worker"}},
    {"/tessera.v1.Workers/Heartbeat", {"worker"}},
    {"/tessera.v1.Workers/ReportTask", {"worker"}},
    {"/tessera.v1.Workers/UnregisterWorker", {"worker"}},
    {"/tessera.v1.Workers/ListWorkers", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Workers/GetDemand", {"viewer", "submitter", "admin"}},
    {"/tessera.v1.Blobs/StatBlobs", {"viewer", "submitter", "worker", "admin"}},
    {"/tessera.v1.Blobs/ReadBlob", {"viewer", "submitter", "worker", "admin"}},
    {"/tessera.v1.Blobs/WriteBlob", {"worker"}},
    {"/tessera.v1.Blobs/QueryWrite", {"worker"}},
    {"/tessera.v1.Blobs/GetTransfers", {"viewer", "submitter", "worker", "admin"}},
    {"/tessera.v1.Blobs/CompleteTransfer", {"worker"}},
    {"/grpc.health.v1.Health/Check", {"viewer", "submitter", "worker", "admin"}},
    {"/grpc.health.v1.Health/Watch", {"viewer", "submitter", "worker", "admin"}},
    {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", {"viewer", "submitter", "admin"}},
};

std::vector<std::string> ServedMethods() {
  std::vector<std::string> methods = {"/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                                      "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"};
  for (const google::protobuf::FileDescriptor* file :
       {v1::CreateJobRequest::descriptor()->file(), v1::RegisterWorkerRequest::descriptor()->file(),
        v1::ReadBlobRequest::descriptor()->file()}) {
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        methods.push_back("/" + file->service(s)->full_name() + "/" + file->service(s)->method(m)->name());
      }
    }
  }
  return methods;
}

class AccessControlTest : public ServerTest {
 protected:
  AccessControlTest() {
    TokenTable table;
    for (const char* role : kRoleNames) {
      tokens_[role] = RandomSecret();
      EXPECT_TRUE(table.Add({std::string("a-") + role, *ParseRole(role), Sha256Hex(tokens_[role]), 0}).ok());
    }
    tokens_["expired"] = RandomSecret();
    EXPECT_TRUE(table.Add({"old", Role::kAdmin, Sha256Hex(tokens_["expired"]), clock_.UnixTimeUs() - 1}).ok());
    EXPECT_TRUE(WriteSecretFile(token_file_, table.ToText()).ok());
    access_ = *Access::Open("key of workers", token_file_, &clock_);
    environment_.access = access_.get();
    environment_.transfers = &signing_.transfers;
    RestartServer();
  }
  // The server uses access_.
  ~AccessControlTest() override { server_.reset(); }

  static Metadata Token(const std::string& token) { return {{"authorization", "Bearer " + token}}; }
  Metadata TokenOf(const std::string& role) { return Token(tokens_[role]); }
  Metadata WorkerCall(const std::string& name, const std::string& secret) {
    Metadata metadata = TokenOf("worker");
    metadata.emplace_back(kWorkerMetadata, name);
    metadata.emplace_back(kWorkerSecretMetadata, secret);
    return metadata;
  }
  // Calls the method with one message. *answer: bytes of the last answer, if any.
  static Status CallOn(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                       const std::string& request, const Metadata& metadata, std::string* answer = nullptr) {
    return FromGrpc(RawCall(channel, method, request, metadata, answer));
  }
  Status Call(const std::string& method, const std::string& request, const Metadata& metadata,
              std::string* answer = nullptr) {
    return CallOn(channel_, method, request, metadata, answer);
  }
  v1::RegisterWorkerResponse RegisterOverRpc() {
    v1::RegisterWorkerRequest request;
    request.set_version(kAlgorithmVersion);
    std::string answer;
    EXPECT_TRUE(
        Call("/tessera.v1.Workers/RegisterWorker", request.SerializeAsString(), TokenOf("worker"), &answer).ok());
    v1::RegisterWorkerResponse response;
    EXPECT_TRUE(response.ParseFromString(answer));
    return response;
  }
  std::string SubmitScene() {
    NewJob job = AJob(2);
    job.scene_path = scene_;
    job.scene_files = {{"image", *HashFile(scene_ + "/image")}};
    return Create(job);
  }
  v1::Lease LeaseAs(const v1::RegisterWorkerResponse& worker) {
    v1::LeaseTaskRequest request;
    request.set_worker(worker.worker());
    std::string answer;
    EXPECT_TRUE(Call("/tessera.v1.Workers/LeaseTask", request.SerializeAsString(),
                     WorkerCall(worker.worker(), worker.secret()), &answer)
                    .ok());
    v1::LeaseTaskResponse response;
    EXPECT_TRUE(response.ParseFromString(answer));
    return response.lease();
  }

  SigningTransfers signing_;
  std::map<std::string, std::string> tokens_;  // by role
  std::string token_file_ = folder_.path() + "/tokens";
  std::unique_ptr<Access> access_;
};

TEST_F(AccessControlTest, TheOwnerOfAJobIsTheTokenThatCreatedIt) {
  v1::CreateJobRequest request;
  request.set_scene_path(scene_);
  request.mutable_settings()->set_tiles(2);
  std::string answer;
  ASSERT_TRUE(Call("/tessera.v1.Jobs/CreateJob", request.SerializeAsString(), TokenOf("submitter"), &answer).ok());
  v1::Job job;
  ASSERT_TRUE(job.ParseFromString(answer));
  EXPECT_EQ(job.owner(), "a-submitter");
  v1::GetJobRequest get;
  get.set_name(job.name());
  ASSERT_TRUE(Call("/tessera.v1.Jobs/GetJob", get.SerializeAsString(), TokenOf("viewer"), &answer).ok());
  ASSERT_TRUE(job.ParseFromString(answer));
  EXPECT_EQ(job.owner(), "a-submitter");
}

TEST_F(AccessControlTest, EveryServedMethodHasAnAccessRule) {
  const std::vector<std::string> served = ServedMethods();
  EXPECT_EQ(served.size(), kMayCall.size());
  for (const std::string& method : served) {
    ASSERT_TRUE(kMayCall.contains(method)) << method << " has no row";
    ASSERT_TRUE(RolesFor(method).has_value()) << method << " has no rule";
    for (const char* role : kRoleNames) {
      EXPECT_EQ((*RolesFor(method) & static_cast<unsigned>(*ParseRole(role))) != 0, kMayCall.at(method).contains(role))
          << method << " " << role;
    }
  }
  EXPECT_FALSE(RolesFor("/tessera.v1.Jobs/Another").has_value());
}

TEST_F(AccessControlTest, CallsOutsideTheRoleAreDeniedWithoutInformation) {
  const std::string job = SubmitScene();
  const auto victim = RegisterOverRpc();
  const v1::Lease lease = LeaseAs(victim);
  const auto before = store_.records;
  // Valid for several methods, which would change state.
  v1::GetJobRequest named;
  named.set_name(job);
  const std::string request = named.SerializeAsString();
  const std::map<std::string, Metadata> strangers = {
      {"no token", {}},
      {"an unknown token", Token(RandomSecret())},
      {"an expired token", TokenOf("expired")},
      {"an empty token", Token("")},
      {"the hash of a token", Token(Sha256Hex(tokens_["admin"]))},
      {"another scheme", {{"authorization", "Basic " + tokens_["admin"]}}},
      {"two tokens", {Token(tokens_["viewer"])[0], Token(tokens_["admin"])[0]}},
      {"a worker's secret alone", {{kWorkerMetadata, victim.worker()}, {kWorkerSecretMetadata, victim.secret()}}},
  };
  std::vector<std::string> methods = ServedMethods();
  methods.push_back("/tessera.v1.Jobs/Another");
  const auto tells_nothing = [&](const Status& status) {
    for (const std::string& secret : {scene_, job, lease.spec().task(), victim.worker(), tokens_["admin"]}) {
      EXPECT_THAT(std::string(status.message()), Not(HasSubstr(secret)));
    }
  };
  for (const std::string& method : methods) {
    SCOPED_TRACE(method);
    for (const auto& [who, metadata] : strangers) {
      const Status status = Call(method, request, metadata);
      EXPECT_EQ(status.code(), absl::StatusCode::kUnauthenticated) << who << ": " << status;
      tells_nothing(status);
    }
    for (const char* role : kRoleNames) {
      if (kMayCall.contains(method) && kMayCall.at(method).contains(role)) continue;
      const Status status = Call(method, request, TokenOf(role));
      EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << role << ": " << status;
      tells_nothing(status);
    }
  }
  EXPECT_EQ(store_.records, before) << "a refused call changed state";
  EXPECT_EQ(coordinator_->leases().ListWorkers().size(), 1u);
  EXPECT_EQ(coordinator_->leases().ListWorkers()[0].tasks.size(), 1u);
  // Calls within the role are accepted.
  EXPECT_TRUE(Call("/tessera.v1.Jobs/GetJob", request, TokenOf("viewer")).ok());
  EXPECT_TRUE(Call("/grpc.health.v1.Health/Check", "", TokenOf("worker")).ok());
  EXPECT_TRUE(Call("/tessera.v1.Jobs/CancelJob", request, TokenOf("submitter")).ok());
}

TEST_F(AccessControlTest, RefusedChangesAreLoggedAtALimitedRate) {
  SubmitScene();
  v1::CancelJobRequest cancel;
  cancel.set_name("jobs/1");
  const auto logged = [&](const std::string& method, const Metadata& metadata, int times) {
    testing::internal::CaptureStderr();
    EXPECT_TRUE(SetUpLog("info", false).ok());
    for (int i = 0; i < times; ++i) EXPECT_FALSE(Call(method, cancel.SerializeAsString(), metadata).ok());
    EXPECT_TRUE(SetUpLog("off", false).ok());
    return testing::internal::GetCapturedStderr();
  };
  const std::string method = "/tessera.v1.Jobs/CancelJob";
  EXPECT_THAT(logged(method, TokenOf("viewer"), 1),
              HasSubstr(" info audit action=CancelJob outcome=PERMISSION_DENIED user=a-viewer error="));
  const std::string stranger = logged(method, {}, 1);
  EXPECT_THAT(stranger, HasSubstr(" info audit action=CancelJob outcome=UNAUTHENTICATED error="));
  EXPECT_THAT(stranger, Not(HasSubstr("user=")));
  EXPECT_EQ(logged("/tessera.v1.Jobs/GetJob", {}, 1), "");
  const auto begun = std::chrono::steady_clock::now();
  const std::string flood = logged(method, {}, 300);
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now() - begun);
  EXPECT_LE(std::count(flood.begin(), flood.end(), '\n'), 10 * (seconds.count() + 2));
}

TEST_F(AccessControlTest, WorkerCannotImpersonateAnother) {
  SubmitScene();
  const auto victim = RegisterOverRpc(), thief = RegisterOverRpc();
  ASSERT_NE(victim.secret(), thief.secret());
  const v1::Lease lease = LeaseAs(victim);
  const auto before = store_.records;
  v1::LeaseTaskRequest ask;
  ask.set_worker(victim.worker());
  v1::HeartbeatRequest heartbeat;
  heartbeat.set_worker(victim.worker());
  v1::ReportTaskRequest report;
  report.set_worker(victim.worker());
  report.set_task(lease.spec().task());
  report.set_attempt(lease.attempt());
  report.mutable_failure()->set_message("poisoned");
  v1::UnregisterWorkerRequest leave;
  leave.set_worker(victim.worker());
  const std::map<std::string, std::string> calls = {
      {"/tessera.v1.Workers/LeaseTask", ask.SerializeAsString()},
      {"/tessera.v1.Workers/Heartbeat", heartbeat.SerializeAsString()},
      {"/tessera.v1.Workers/ReportTask", report.SerializeAsString()},
      {"/tessera.v1.Workers/UnregisterWorker", leave.SerializeAsString()},
  };
  const auto other_key = *Access::Open("another key", token_file_, &clock_);
  const std::map<std::string, Metadata> thieves = {
      {"his own name and secret", WorkerCall(thief.worker(), thief.secret())},
      {"the victim's name, his own secret", WorkerCall(victim.worker(), thief.secret())},
      {"no secret", TokenOf("worker")},
      {"a secret by another key", WorkerCall(victim.worker(), other_key->SecretOf(victim.worker()))},
  };
  for (const auto& [method, request] : calls) {
    for (const auto& [who, metadata] : thieves) {
      const Status status = Call(method, request, metadata);
      EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << method << ", " << who;
      EXPECT_EQ(RefusalOf(status), Refusal::kUnknownWorker) << "the worker would not register again";
    }
  }
  EXPECT_EQ(store_.records, before);
  const Metadata own = WorkerCall(victim.worker(), victim.secret());
  ASSERT_TRUE(Call("/tessera.v1.Workers/ReportTask", calls.at("/tessera.v1.Workers/ReportTask"), own).ok());
  // Replayed calls: of an ended attempt, and of an unregistered worker.
  LeaseAs(victim);
  EXPECT_EQ(RefusalOf(Call("/tessera.v1.Workers/ReportTask", calls.at("/tessera.v1.Workers/ReportTask"), own)),
            Refusal::kNotCurrent);
  ASSERT_TRUE(Call("/tessera.v1.Workers/UnregisterWorker", calls.at("/tessera.v1.Workers/UnregisterWorker"), own).ok());
  EXPECT_EQ(RefusalOf(Call("/tessera.v1.Workers/LeaseTask", calls.at("/tessera.v1.Workers/LeaseTask"), own)),
            Refusal::kUnknownWorker);
}

TEST_F(AccessControlTest, BlobReadsAreAuthorizedPerCaller) {
  SubmitScene();
  const Digest scene_file = *HashFile(scene_ + "/image"), unpublished = *blobs_->PutBytes("of a task"),
               nowhere = DigestOf("nowhere");
  const auto worker = RegisterOverRpc(), idle = RegisterOverRpc();
  ASSERT_TRUE(LeaseAs(worker).has_spec());
  const auto read = [&](const Digest& digest, const Metadata& metadata) {
    v1::ReadBlobRequest request;
    request.mutable_digest()->set_sha256(digest.sha256);
    request.mutable_digest()->set_size_bytes(digest.size_bytes);
    request.set_offset(digest.size_bytes);  // an answer without data
    v1::StatBlobsRequest stat;
    *stat.add_digests() = request.digest();
    std::string held;
    EXPECT_TRUE(Call("/tessera.v1.Blobs/StatBlobs", stat.SerializeAsString(), metadata, &held).ok());
    v1::StatBlobsResponse response;
    EXPECT_TRUE(response.ParseFromString(held));
    Status status = Call("/tessera.v1.Blobs/ReadBlob", request.SerializeAsString(), metadata);
    // A stream that ends without a message was accepted.
    if (!absl::IsPermissionDenied(status) && !absl::IsNotFound(status)) status = absl::OkStatus();
    EXPECT_EQ(response.stored(0), status.ok());
    v1::GetTransfersRequest transfers;
    *transfers.add_digests() = request.digest();
    std::string answer;
    const Status url = Call("/tessera.v1.Blobs/GetTransfers", transfers.SerializeAsString(), metadata, &answer);
    if (absl::IsPermissionDenied(status)) {
      EXPECT_EQ(url, status) << "a URL for whoever may not read";
    } else {
      EXPECT_TRUE(url.ok()) << url;
    }
    return status;
  };
  const Metadata leased = WorkerCall(worker.worker(), worker.secret()), free = WorkerCall(idle.worker(), idle.secret());
  EXPECT_TRUE(read(scene_file, leased).ok());
  const std::map<std::string, Metadata> others = {
      {"a worker without that lease", free},
      {"another's name", WorkerCall(worker.worker(), idle.secret())},
      {"a viewer", TokenOf("viewer")},
      {"a submitter", TokenOf("submitter")},
  };
  for (const auto& [who, metadata] : others) {
    const Status refused = read(nowhere, metadata);
    EXPECT_EQ(refused.code(), absl::StatusCode::kPermissionDenied) << who;
    for (const Digest& digest : {scene_file, unpublished}) {
      EXPECT_EQ(read(digest, metadata), refused) << who << " learns that the blob exists";
    }
  }
  EXPECT_EQ(read(unpublished, leased).code(), absl::StatusCode::kPermissionDenied);
  EXPECT_TRUE(read(unpublished, TokenOf("admin")).ok());
  EXPECT_EQ(read(scene_file, TokenOf("admin")).code(), absl::StatusCode::kNotFound) << "not a result";
  v1::QueryWriteRequest query;
  query.mutable_digest()->set_sha256(unpublished.sha256);
  query.mutable_digest()->set_size_bytes(unpublished.size_bytes);
  const std::string asked = query.SerializeAsString();
  EXPECT_TRUE(Call("/tessera.v1.Blobs/QueryWrite", asked, leased).ok());
  for (const char* method : {"/tessera.v1.Blobs/QueryWrite", "/tessera.v1.Blobs/WriteBlob"}) {
    EXPECT_EQ(Call(method, asked, free).code(), absl::StatusCode::kPermissionDenied) << method;
  }
  v1::GetTransfersRequest upload;
  *upload.add_digests() = query.digest();
  upload.set_write(true);
  v1::CompleteTransferRequest complete;
  *complete.mutable_digest() = query.digest();
  for (const Metadata& metadata : {free, TokenOf("viewer"), TokenOf("submitter"), TokenOf("admin")}) {
    EXPECT_EQ(Call("/tessera.v1.Blobs/GetTransfers", upload.SerializeAsString(), metadata).code(),
              absl::StatusCode::kPermissionDenied);
    EXPECT_EQ(Call("/tessera.v1.Blobs/CompleteTransfer", complete.SerializeAsString(), metadata).code(),
              absl::StatusCode::kPermissionDenied);
  }
  // Viewers may read published results.
  Metadata nobody;
  for (const auto& status : coordinator_->leases().ListWorkers())
    EXPECT_TRUE(UnregisterAndWait(*coordinator_, status.name).ok());
  const std::string own = Worker();
  std::optional<GrantedLease> lease;
  Digest survey, refined, mesh;
  while ((lease = Lease(own))) {
    for (const NamedDigest& output : Result(*lease).outputs) {
      if (output.name == "survey.json") survey = output.digest;
      if (output.name == "refined") refined = output.digest;
      if (output.name == "mesh.ply") mesh = output.digest;
    }
    ASSERT_TRUE(Succeed(own, *lease).ok());
  }
  EXPECT_TRUE(read(mesh, TokenOf("viewer")).ok());
  EXPECT_TRUE(read(survey, TokenOf("viewer")).ok());
  EXPECT_EQ(read(refined, TokenOf("viewer")).code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(read(mesh, free).code(), absl::StatusCode::kPermissionDenied) << "a worker without a lease";
}

TEST_F(AccessControlTest, TokenFileChangesTakeEffect) {
  const std::string list = "/tessera.v1.Jobs/ListJobs";
  TokenTable table = *TokenTable::Read(token_file_);
  ASSERT_TRUE(Call(list, "", TokenOf("viewer")).ok());
  grpc::ClientContext watching;
  SetDeadline(watching, 20);
  watching.AddMetadata("authorization", "Bearer " + tokens_["viewer"]);
  v1::WatchJobRequest watch;
  watch.set_name(SubmitScene());
  const auto updates = jobs_->WatchJob(&watching, watch);
  v1::WatchJobResponse update;
  ASSERT_TRUE(updates->Read(&update));
  ASSERT_TRUE(table.Remove("a-viewer"));
  ASSERT_TRUE(WriteSecretFile(token_file_, table.ToText()).ok());
  ASSERT_TRUE(access_->Refresh().ok());
  EXPECT_EQ(Call(list, "", TokenOf("viewer")).code(), absl::StatusCode::kUnauthenticated);
  while (updates->Read(&update)) {
  }
  EXPECT_EQ(updates->Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED) << "watches check their token again";
  EXPECT_TRUE(Call(list, "", TokenOf("admin")).ok());
  ASSERT_TRUE(WriteSecretFile(token_file_, "a-viewer viewer " + tokens_["viewer"] + " never\n").ok());
  const Status faulty = access_->Refresh();
  EXPECT_THAT(std::string(faulty.message()),
              testing::AllOf(HasSubstr(token_file_), HasSubstr("line 1"), Not(HasSubstr(tokens_["viewer"]))));
  EXPECT_TRUE(Call(list, "", TokenOf("admin")).ok()) << "the earlier tokens stay valid";
  ASSERT_TRUE(RemoveTree(token_file_).ok());
  EXPECT_FALSE(access_->Refresh().ok());
  EXPECT_TRUE(Call(list, "", TokenOf("admin")).ok());
  EXPECT_FALSE(Access::Open("key", token_file_, &clock_).ok()) << "the file is required at the start";
}

TEST_F(AccessControlTest, ClientCertificatesAreRequiredBesideTokens) {
  const int64_t now_s = SystemClock().UnixTimeUs() / 1'000'000;
  const auto write = [&](const std::string& stem, const Certificate& made) {
    EXPECT_TRUE(WriteSecretFile(folder_.path() + "/" + stem + ".pem", made.certificate_pem).ok());
    EXPECT_TRUE(WriteSecretFile(folder_.path() + "/" + stem + ".key", made.key_pem).ok());
  };
  const Certificate ca = *MakeAuthority({"ours", {}, now_s, -3600, 86400});
  const Certificate foreign = *MakeAuthority({"ours", {}, now_s, -3600, 86400});
  write("ca", ca);
  write("foreign-ca", foreign);
  write("server", *MakeCertificate(ca, {"server", {"localhost", "127.0.0.1"}, now_s, -3600, 86400}));
  write("good", *MakeCertificate(ca, {"good", {}, now_s, -3600, 86400}));
  write("expired", *MakeCertificate(ca, {"expired", {}, now_s, -7200, -3600}));
  write("foreign", *MakeCertificate(foreign, {"good", {}, now_s, -3600, 86400}));
  ListenOptions options;
  const auto file = [&](const std::string& name) { return folder_.path() + "/" + name; };
  options.addresses = {"127.0.0.1:0"};
  options.tls_cert = file("server.pem");
  options.tls_key = file("server.key");
  options.tls_ca = file("ca.pem");
  server_->Shutdown(1);
  Restart();
  environment_.coordinator = coordinator_.get();
  server_ = *CoordinatorServer::Start(options, environment_);
  const std::string port = server_->address().substr(server_->address().rfind(':'));
  const auto call = [&](const std::string& ca_file, const std::string& own, const std::string& host = "127.0.0.1") {
    Endpoint endpoint(host + port);
    endpoint.tls_ca = file(ca_file);
    if (!own.empty()) {
      endpoint.tls_cert = file(own + ".pem");
      endpoint.tls_key = file(own + ".key");
    }
    const auto channel = OpenChannel(endpoint, nullptr);
    EXPECT_TRUE(channel.ok()) << channel.status();
    return CallOn(*channel, "/tessera.v1.Jobs/ListJobs", "", TokenOf("admin"));
  };
  EXPECT_TRUE(call("ca.pem", "good").ok());
  EXPECT_TRUE(call("ca.pem", "good", "localhost").ok());
  EXPECT_EQ(call("ca.pem", "").code(), absl::StatusCode::kUnavailable) << "no certificate";
  EXPECT_EQ(call("ca.pem", "expired").code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(call("ca.pem", "foreign").code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(call("foreign-ca.pem", "good").code(), absl::StatusCode::kUnavailable)
      << "the caller does not trust the server's authority";
  Endpoint endpoint("127.0.0.1" + port);
  EXPECT_EQ(CallOn(MakeChannel(endpoint.address), "/tessera.v1.Jobs/ListJobs", "", TokenOf("admin")).code(),
            absl::StatusCode::kUnavailable)
      << "no TLS";
  endpoint.tls_ca = file("ca.pem");
  endpoint.tls_cert = file("good.pem");
  endpoint.tls_key = file("good.key");
  EXPECT_EQ(CallOn(*OpenChannel(endpoint, nullptr), "/tessera.v1.Jobs/ListJobs", "", {}).code(),
            absl::StatusCode::kUnauthenticated)
      << "a certificate without a token";
}

TEST_F(AccessControlTest, SocketNeedsNoToken) {
  ListenOptions options;
  options.addresses = {"unix:" + folder_.path() + "/socket", "127.0.0.1:0"};
  environment_.scenes_over_network = false;
  server_->Shutdown(1);
  Restart();
  environment_.coordinator = coordinator_.get();
  server_ = *CoordinatorServer::Start(options, environment_);
  EXPECT_EQ(CoordinatorServer::Start(options, environment_).status().code(), absl::StatusCode::kUnavailable)
      << "the socket is in use";
  const auto socket = MakeChannel(server_->addresses()[0]), tcp = MakeChannel(server_->addresses()[1]);
  EXPECT_TRUE(CallOn(socket, "/tessera.v1.Jobs/ListJobs", "", {}).ok());
  EXPECT_EQ(CallOn(tcp, "/tessera.v1.Jobs/ListJobs", "", {}).code(), absl::StatusCode::kUnauthenticated);
  v1::CreateJobRequest request;
  request.set_scene_path(scene_);
  request.mutable_settings()->set_tiles(2);
  const Status asked = CallOn(tcp, "/tessera.v1.Jobs/CreateJob", request.SerializeAsString(), TokenOf("submitter"));
  EXPECT_EQ(asked.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(asked.message()), HasSubstr("--scene-root"));
  EXPECT_TRUE(CallOn(socket, "/tessera.v1.Jobs/CreateJob", request.SerializeAsString(), {}).ok());
}

}  // namespace
}  // namespace tessera
