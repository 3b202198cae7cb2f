// A coordinator whose results are in an S3 store, and workers that share no folder with it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "tests/e2e/programs.h"
#include "tests/support/http_get.h"
#include "tests/support/servers/test_s3.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class ObjectStoreTest : public testing::Test {
 protected:
  void SetUp() override { TESSERA_NEED_SERVER("radosgw"); }

  // Programs that `start` starts get the credentials.
  template <class Start>
  auto WithCredentials(const Start& start) {
    const S3Credentials keys = TestCredentials();
    const std::string file = folder_.path() + "/credentials";
    if (!fs::exists(file)) {
      std::ofstream(file) << "[default]\naws_access_key_id = " << keys.access_key
                          << "\naws_secret_access_key = " << keys.secret_key << "\n";
      fs::permissions(file, fs::perms::owner_read);
    }
    ::setenv("AWS_SHARED_CREDENTIALS_FILE", file.c_str(), 1);
    auto started = start();
    ::unsetenv("AWS_SHARED_CREDENTIALS_FILE");
    return started;
  }
  // A coordinator of a new prefix. Only it gets the credentials: from a file of AWS's form.
  std::unique_ptr<Cluster> StartCluster(const std::vector<std::string>& more = {}) {
    location_ = NewTestLocation();
    std::vector<std::string> arguments = {"--blobs", ToText(location_), "--s3-endpoint", location_.endpoint};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return WithCredentials([&] { return std::make_unique<Cluster>(folder_.path(), 15, arguments); });
  }
  static std::string ProcessFile(pid_t pid, const std::string& name) {
    return Content("/proc/" + std::to_string(pid) + "/" + name);
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  S3Location location_;
};

TEST_F(ObjectStoreTest, SameBytesWithoutASharedFolderAndWithoutSecretsInWorkers) {
  const auto cluster = StartCluster({"--metrics-listen", "127.0.0.1:0"});
  const std::vector<std::string> flags = {"--no-shared-storage"};
  for (int i = 0; i < 2; ++i) cluster->AddWorker(flags);
  const v1::Job job = cluster->Await(cluster->Submit(ToyCity(), 4).name());
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  EXPECT_TRUE(Content(cluster->Fetch(job.name()) + "/mesh.ply") == Content(UndisturbedMesh()));
  const TestS3 s3({}, location_);
  EXPECT_FALSE(s3.client->List("blobs/")->objects.empty());
  EXPECT_TRUE(s3.client->List("probe/")->objects.empty());
  EXPECT_FALSE(fs::exists(cluster->data() + "/blobs")) << "the coordinator stores results in its folder";

  const std::string started = cluster->coordinator().Output(), page = "metrics: http://";
  const size_t at = started.find(page) + page.size();
  const std::string metrics = HttpGet(started.substr(at, started.find('/', at) - at), "/metrics");
  EXPECT_THAT(metrics, HasSubstr("tessera_blob_bytes_total{direction=\"written\"} 0\n"));
  EXPECT_THAT(metrics, HasSubstr("tessera_store_requests_total{method=\"head\"}"));
  EXPECT_THAT(metrics, Not(HasSubstr("tessera_store_requests_total{method=\"head\"} 0\n")));

  std::vector<std::string> seen = {cluster->coordinator().Output(), metrics,
                                   ProcessFile(cluster->coordinator().pid(), "cmdline"),
                                   ProcessFile(cluster->coordinator().pid(), "environ")};
  for (const auto& worker : cluster->workers()) {
    for (const char* name : {"cmdline", "environ"}) seen.push_back(ProcessFile(worker->pid(), name));
    seen.push_back(worker->Output());
    EXPECT_THAT(ProcessFile(worker->pid(), "environ"), Not(HasSubstr("AWS_SHARED_CREDENTIALS_FILE")));
  }
  for (const fs::directory_entry& file : fs::recursive_directory_iterator(cluster->data())) {
    if (file.is_regular_file()) seen.push_back(Content(file.path().string()));
  }
  for (const std::string& text : seen) {
    EXPECT_THAT(text, Not(HasSubstr(TestCredentials().secret_key)));
    EXPECT_THAT(text, Not(HasSubstr("X-Amz-Signature")));
  }
}

// Neither the coordinator nor a worker has the scene's folder.
TEST_F(ObjectStoreTest, SceneInTheStoreGivesTheSameBytes) {
  const TempFolder scene = *TempFolder::Create(testing::TempDir());
  fs::copy(ToyCity(), scene.path() + "/city", fs::copy_options::recursive);
  const S3Location place = NewTestLocation();
  const std::string url = ToText(place) + "city";
  const auto upload = [&] {
    const Outcome sent = WithCredentials([&] {
      return Tessera(folder_.path(), {"upload", scene.path() + "/city", url, "--s3-endpoint", place.endpoint});
    });
    ASSERT_EQ(sent.exit_code, 0) << sent.output;
    EXPECT_THAT(sent.output, HasSubstr(url + "/tessera.manifest.json"));
  };
  upload();
  const Outcome ran = WithCredentials([&] {
    ::setenv("AWS_ENDPOINT_URL", place.endpoint.c_str(), 1);
    Outcome outcome = Tessera(folder_.path(), {"run", url, "--tiles", "4", "--out", folder_.path() + "/run"});
    ::unsetenv("AWS_ENDPOINT_URL");
    return outcome;
  });
  EXPECT_EQ(ran.exit_code, 0) << ran.output;
  EXPECT_TRUE(Content(folder_.path() + "/run/mesh.ply") == Content(UndisturbedMesh()));
  const auto cluster = StartCluster({"--scene-root", ToText(place)});
  const std::vector<std::string> flags = {"--no-shared-storage"};
  for (int i = 0; i < 2; ++i) cluster->AddWorker(flags);
  const auto submit = [&](const std::string& from, const std::vector<std::string>& more, const char* tiles = "4") {
    std::vector<std::string> arguments = {"submit", from, "--coordinator", cluster->address(), "--tiles", tiles};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Tessera(folder_.path(), arguments);
  };
  const Outcome validated = submit(url + "/", {"--validate-only"});
  EXPECT_EQ(validated.exit_code, 0) << validated.output;
  const Outcome submitted = submit(url, {});
  ASSERT_EQ(submitted.exit_code, 0) << submitted.output;
  fs::remove_all(scene.path() + "/city");
  const v1::Job job = cluster->Await("jobs/1");
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  EXPECT_EQ(job.scene_path(), url);
  EXPECT_TRUE(Content(cluster->Fetch(job.name()) + "/mesh.ply") == Content(UndisturbedMesh()));

  // Faults are those of the folder; a place outside is refused.
  fs::copy(ToyCity(), scene.path() + "/city", fs::copy_options::recursive);
  const std::string image = fs::directory_iterator(scene.path() + "/city/images")->path().filename().string();
  fs::remove(scene.path() + "/city/images/" + image);
  const TestS3 s3({}, place);
  ASSERT_TRUE(s3.client->Delete({"city/images/" + image}).ok());
  const Outcome missing = submit(url, {"--validate-only"});
  EXPECT_EQ(missing.exit_code, 3);
  EXPECT_THAT(missing.output, HasSubstr(url + "/images/" + image + ": found no such file"));
  EXPECT_THAT(submit("s3://elsewhere/city", {"--validate-only"}).output, HasSubstr("in no --scene-root"));

  // A job whose scene changed afterwards fails and names the file.
  fs::copy(ToyCity() + "/images/" + image, scene.path() + "/city/images/" + image);
  upload();
  std::string content = Content(scene.path() + "/city/images/" + image);
  content[content.size() / 2] ^= 1;
  ASSERT_TRUE(s3.client->Put("city/images/" + image, content, Sha256Hex(content)).ok());
  ASSERT_EQ(submit(url, {}, "3").exit_code, 0);
  for (const auto& worker : cluster->workers()) worker->Kill();
  for (int i = 0; i < 2; ++i) cluster->AddWorker(flags);  // with an empty cache
  const v1::Job changed = cluster->Await("jobs/2");
  EXPECT_EQ(changed.state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(changed.error(), HasSubstr(image + " has changed: " + url + "/images/" + image));
}

// Uses a store of its own, which it stops, kills and fills.
TEST_F(ObjectStoreTest, OutagesOfTheStoreDelayTheJob) {
  const std::string servers = folder_.path() + "/servers", script = TESSERA_START_RADOSGW;
  const auto gateway = [&](const std::vector<std::string>& action) {
    std::vector<std::string> arguments = {servers + "/radosgw"};
    arguments.insert(arguments.end(), action.begin(), action.end());
    const Outcome outcome = Program(folder_.path(), script, arguments).Wait();
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  };
  const std::string shared = ::getenv("TESSERA_TEST_SERVERS");
  ::setenv("TESSERA_TEST_SERVERS", servers.c_str(), 1);
  gateway({});
  {
    const auto cluster = StartCluster();
    const std::vector<std::string> flags = {"--no-shared-storage"};
    for (int i = 0; i < 2; ++i) cluster->AddWorker(flags);
    const std::string name = cluster->Submit(ToyCity(), 4).name();
    const auto succeeded = [&](const std::string& kind) {
      int count = 0;
      for (const v1::Task& task : cluster->Tasks(name)) {
        count += task.kind() == kind && task.state() == v1::TASK_STATE_SUCCEEDED;
      }
      return count;
    };
    ASSERT_TRUE(WaitUntil([&] { return succeeded("crop") > 0; }));
    const pid_t pid = std::stoi(ServerFile("radosgw", "pid"));
    ASSERT_EQ(::kill(pid, SIGSTOP), 0);
    // Nothing can be read or stored. The coordinator goes on serving.
    ASSERT_FALSE(WaitUntil([&] { return cluster->Tasks(name).empty(); }, 2));
    ASSERT_EQ(::kill(pid, SIGCONT), 0);
    ASSERT_TRUE(WaitUntil([&] { return succeeded("measure") > 0; }));
    gateway({"kill"});
    ASSERT_FALSE(WaitUntil([&] { return cluster->Tasks(name).empty(); }, 2));
    // A full bucket: results wait for room, as on a full disk. The quota is set before the store is back, so that no
    // result is stored in between.
    gateway({"quota", "1"});
    gateway({"again"});
    ASSERT_TRUE(WaitUntil([&] {
      const std::vector<v1::Task> tasks = cluster->Tasks(name);
      return std::any_of(tasks.begin(), tasks.end(), [](const v1::Task& task) {
        return task.stage().find("waiting for storage space") != std::string::npos;
      });
    })) << "no worker found the store full";
    gateway({"quota", "-1"});
    const v1::Job job = cluster->Await(name);
    EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
    if (job.state() == v1::JOB_STATE_SUCCEEDED) {
      EXPECT_TRUE(Content(cluster->Fetch(job.name()) + "/mesh.ply") == Content(UndisturbedMesh()));
    }
  }
  gateway({"stop"});
  ::setenv("TESSERA_TEST_SERVERS", shared.c_str(), 1);
}

TEST_F(ObjectStoreTest, WrongStoreIsToldAtTheStart) {
  const S3Location location = NewTestLocation();
  const auto start = [&](const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"--data", folder_.path() + "/data", "--listen", "127.0.0.1:0"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return Program(folder_.path(), TESSERAD_PROGRAM, all).Wait();
  };
  EXPECT_THAT(start({"--blobs", "http://bucket"}).output, HasSubstr("expected a folder or s3://BUCKET"));
  ::setenv("AWS_ACCESS_KEY_ID", TestCredentials().access_key.c_str(), 1);
  ::setenv("AWS_SECRET_ACCESS_KEY", "not-the-secret", 1);
  const Outcome refused = start({"--blobs", ToText(location), "--s3-endpoint", location.endpoint});
  ::unsetenv("AWS_ACCESS_KEY_ID");
  ::unsetenv("AWS_SECRET_ACCESS_KEY");
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.output, HasSubstr("credentials"));
  EXPECT_THAT(refused.output, Not(HasSubstr("not-the-secret")));
}

}  // namespace
}  // namespace tessera::e2e
