// Access control with the real programs: certificates, tokens and scene roots, set up as an operator would.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class AccessTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
  void MakeKeys() {
    for (const auto& arguments : std::vector<std::vector<std::string>>{
             {"access", "server", Path("keys"), "localhost"},
             {"access", "token", Path("keys"), "anna:submitter", "vera:viewer", "rack:worker"}}) {
      const Outcome made = Tessera(folder_.path(), arguments);
      ASSERT_EQ(made.exit_code, 0) << made.output;
    }
  }
  // With a coordinator at `localhost`, as the name's bearer.
  Outcome TesseraAs(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--coordinator", address_, "--tls-ca", Path("keys/ca.pem")});
    if (!name.empty()) arguments.insert(arguments.end(), {"--token-file", Path("keys/" + name + ".token")});
    return Tessera(folder_.path(), arguments);
  }
  std::unique_ptr<Program> Serve(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--data", Path("data"), "--port-file", Path("address")});
    fs::remove(Path("address"));
    auto program = std::make_unique<Program>(folder_.path(), TESSERAD_PROGRAM, arguments);
    EXPECT_TRUE(WaitUntil([&] { return fs::exists(Path("address")) || !program->Running(); }));
    if (fs::exists(Path("address"))) {
      address_ = Content(Path("address"));
      address_.erase(address_.find_last_not_of('\n') + 1);
    }
    return program;
  }
  std::unique_ptr<Program> ServeTls() {
    MakeKeys();
    fs::create_directories(Path("scenes"));
    fs::copy(ToyCity(), Path("scenes/city"), fs::copy_options::recursive);
    return Serve({"--listen", "localhost:0", "--tls-cert", Path("keys/server.pem"), "--tls-key",
                  Path("keys/server.key"), "--token-file", Path("keys/tokens"), "--scene-root", Path("scenes")});
  }
  std::unique_ptr<Program> Work(const std::string& token) {
    return std::make_unique<Program>(
        folder_.path(), TESSERA_WORKER_PROGRAM,
        std::vector<std::string>{"--coordinator", address_, "--tls-ca", Path("keys/ca.pem"), "--token-file",
                                 Path("keys/" + token + ".token"), "--work", Path("work-" + token), "--threads", "1"});
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  std::string address_;
};

// The modes of all that is in a folder, with its own, that let others do anything.
std::vector<std::string> OpenToOthers(const std::string& folder) {
  std::vector<std::string> open;
  const auto look = [&](const fs::path& path) {
    struct stat info;
    if (::lstat(path.c_str(), &info) == 0 && !S_ISLNK(info.st_mode) && (info.st_mode & 077) != 0) open.push_back(path);
  };
  look(folder);
  for (const auto& entry : fs::recursive_directory_iterator(folder)) look(entry.path());
  return open;
}

bool Holds(const std::string& bytes, const std::string& secret) { return bytes.find(secret) != std::string::npos; }

std::string Bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

TEST_F(AccessTest, JobRunsWithTlsTokensAndRootsWithoutLeakingSecrets) {
  const auto coordinator = ServeTls();
  ASSERT_TRUE(coordinator->Running()) << coordinator->Output();
  const auto worker = Work("rack");
  const Outcome submitted = TesseraAs("anna", {"submit", Path("scenes/city"), "--tiles", "2", "--rounds", "1",
                                               "--levels", "1", "--iterations", "2", "--watch"});
  ASSERT_EQ(submitted.exit_code, 0) << submitted.output << coordinator->Output() << worker->Output();
  const Outcome fetched = TesseraAs("vera", {"fetch", "jobs/1", "--out", Path("out")});
  EXPECT_EQ(fetched.exit_code, 0) << fetched.output;

  const Outcome viewer = TesseraAs("vera", {"cancel", "jobs/1"});
  EXPECT_EQ(viewer.exit_code, 1) << viewer.output;
  EXPECT_THAT(viewer.output, HasSubstr("no role"));
  const Outcome nobody = TesseraAs("", {"jobs"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_THAT(nobody.output, HasSubstr("TESSERA_TOKEN_FILE"));
  const Outcome plain = Tessera(folder_.path(), {"jobs", "--coordinator", address_});
  EXPECT_NE(plain.exit_code, 0);
  const auto wrong = Work("vera");
  EXPECT_EQ(wrong->Wait().exit_code, 1);
  EXPECT_THAT(wrong->Output(), HasSubstr("no role"));

  // Nor may a classifier lie anywhere else; nothing is learnt of what lies there.
  for (const char* name : {"/etc/shadow", "/etc/no-such-file"}) {
    const Outcome outside = TesseraAs("anna", {"submit", Path("scenes/city"), "--classifier", name, "--validate-only"});
    EXPECT_EQ(outside.exit_code, 3);
    EXPECT_THAT(outside.output, HasSubstr(std::string(name) + ": found a path outside the allowed folders"));
  }

  // A scene that leads out of the root, of which nothing is learnt.
  fs::create_directories(Path("elsewhere"));
  std::ofstream(Path("elsewhere/secret")) << "what others must not read\n";
  fs::copy(Path("scenes/city"), Path("scenes/evil"), fs::copy_options::recursive);
  for (const char* target : {"elsewhere/secret", "elsewhere/none"}) {
    fs::remove(Path("scenes/evil/mesh.ply"));
    fs::create_symlink(Path(target), Path("scenes/evil/mesh.ply"));
    const Outcome evil = TesseraAs("anna", {"submit", Path("scenes/evil")});
    EXPECT_EQ(evil.exit_code, 3) << evil.output;
    EXPECT_THAT(evil.output,
                AllOf(HasSubstr("mesh.ply: found a path outside the allowed folders"), Not(HasSubstr("others must"))));
  }
  const Outcome outside = TesseraAs("anna", {"submit", ToyCity()});
  EXPECT_EQ(outside.exit_code, 3) << outside.output;

  // Where secrets must not be.
  std::vector<std::string> secrets;
  for (const char* name : {"anna", "vera", "rack"}) {
    std::string token = Content(Path(std::string("keys/") + name + ".token"));
    token.pop_back();
    secrets.push_back(token);
  }
  secrets.push_back(Content(Path("keys/server.key")).substr(40, 60));
  std::map<std::string, std::string> places = {{"the coordinator's log", coordinator->Output()},
                                               {"the worker's log", worker->Output()},
                                               {"submit", submitted.output},
                                               {"refusals", viewer.output + nobody.output + wrong->Output()},
                                               {"the list of tokens", Content(Path("keys/tokens"))}};
  for (const auto& entry : fs::directory_iterator(Path("data"))) {
    if (entry.is_regular_file() && entry.file_size() > 0) places[entry.path()] = Bytes(entry.path());
  }
  EXPECT_TRUE(places.contains(Path("data") + "/state.sqlite"));
  for (Program* program : {coordinator.get(), worker.get()}) {
    const std::string proc = "/proc/" + std::to_string(program->pid());
    for (const char* file : {"/cmdline", "/environ", "/status", "/limits", "/maps"}) {
      places[proc + file] = Bytes(proc + file);
    }
  }
  for (const auto& [where, bytes] : places) {
    EXPECT_FALSE(bytes.empty()) << where;
    for (const std::string& secret : secrets) EXPECT_FALSE(Holds(bytes, secret)) << where;
  }
  EXPECT_THAT(OpenToOthers(Path("data")), testing::IsEmpty());
  EXPECT_THAT(OpenToOthers(Path("keys")), testing::IsEmpty());
  EXPECT_THAT(OpenToOthers(Path("work-rack")), testing::IsEmpty());

  // A token that is taken back is worth nothing at once, the others are.
  ASSERT_EQ(Tessera(folder_.path(), {"access", "revoke", Path("keys"), "vera"}).exit_code, 0);
  std::ofstream(Path("keys/vera.token")) << secrets[1] << "\n";
  fs::permissions(Path("keys/vera.token"), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_TRUE(WaitUntil([&] { return TesseraAs("vera", {"jobs"}).exit_code != 0; }));
  EXPECT_EQ(TesseraAs("anna", {"jobs"}).exit_code, 0);
}

TEST_F(AccessTest, HealthIsAskedWithTheCertificatesAndTokenOfTheCaller) {
  const auto coordinator = ServeTls();
  const Outcome served = TesseraAs("vera", {"health"});
  EXPECT_EQ(served.exit_code, 0);
  EXPECT_EQ(served.output, "serving\n");
  const Outcome nobody = TesseraAs("", {"health"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_THAT(nobody.output, HasSubstr("TESSERA_TOKEN_FILE"));
  EXPECT_EQ(TesseraAs("vera", {"health", "--timeout-s", "0"}).exit_code, 2);
  coordinator->Kill();
  const Outcome killed = TesseraAs("vera", {"health", "--timeout-s", "0.5"});
  EXPECT_EQ(killed.exit_code, 1);
  EXPECT_THAT(killed.output, HasSubstr("no coordinator answers"));
}

// Certificates of another authority, while a worker and a client are connected.
TEST_F(AccessTest, RenewedCertificatesHoldWithoutRestart) {
  const auto coordinator = ServeTls();
  const auto worker = Work("rack");
  ASSERT_TRUE(WaitUntil([&] { return Holds(worker->Output(), "registered"); })) << worker->Output();
  ASSERT_EQ(Tessera(folder_.path(), {"access", "server", Path("renewed"), "localhost"}).exit_code, 0);
  const auto health = [&](const std::string& authority) {
    return Tessera(folder_.path(), {"health", "--timeout-s", "2", "--coordinator", address_, "--tls-ca",
                                    Path(authority), "--token-file", Path("keys/vera.token")})
        .exit_code;
  };
  EXPECT_EQ(health("renewed/ca.pem"), 1);
  for (const char* file : {"ca.pem", "server.pem", "server.key"}) {
    fs::copy(Path(std::string("renewed/") + file), Path(std::string("keys/") + file),
             fs::copy_options::overwrite_existing);
  }
  EXPECT_TRUE(WaitUntil([&] { return health("renewed/ca.pem") == 0; }));
  const Outcome submitted = TesseraAs("anna", {"submit", Path("scenes/city"), "--tiles", "2", "--rounds", "1",
                                               "--levels", "1", "--iterations", "2", "--watch"});
  EXPECT_EQ(submitted.exit_code, 0) << submitted.output << coordinator->Output() << worker->Output();
  EXPECT_THAT(coordinator->Output(), HasSubstr("certificate renewed"));
  EXPECT_THAT(worker->Output(), HasSubstr("certificate renewed"));
}

// As after a fault of the program, in a folder where the system would leave the core.
TEST_F(AccessTest, CrashedProcessWritesNoCoreFile) {
  const auto coordinator = ServeTls();
  const auto worker = Work("rack");
  ASSERT_TRUE(WaitUntil([&] { return Holds(worker->Output(), "registered"); })) << worker->Output();
  for (Program* program : {coordinator.get(), worker.get()}) {
    rlimit limit = {};
    ASSERT_EQ(::prlimit(program->pid(), RLIMIT_CORE, nullptr, &limit), 0);
    // 1, not 0: the kernel gives no core to a collector either.
    EXPECT_EQ(limit.rlim_cur, 1u);
    EXPECT_EQ(limit.rlim_max, 1u);
    program->Signal(SIGQUIT);
    ASSERT_TRUE(WaitUntil([&] { return !program->Running(); }));
    EXPECT_THAT(program->ExitDescription(), HasSubstr("signal 3"));
  }
  for (const std::string& folder : {folder_.path(), fs::current_path().string()}) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      EXPECT_NE(entry.path().filename().string().substr(0, 4), "core") << entry.path();
    }
  }
}

TEST_F(AccessTest, FolderOfEarlierVersionBecomesPrivate) {
  fs::create_directories(Path("data/blobs/ab"));
  std::ofstream(Path("data/blobs/ab/old")) << "x";
  for (const char* open : {"data", "data/blobs", "data/blobs/ab"}) fs::permissions(Path(open), fs::perms(0755));
  fs::permissions(Path("data/blobs/ab/old"), fs::perms(0644));
  EXPECT_EQ(OpenToOthers(Path("data")).size(), 4u);
  const auto coordinator = Serve({});
  ASSERT_TRUE(coordinator->Running()) << coordinator->Output();
  EXPECT_EQ(address_, "unix:" + Path("data/socket"));
  EXPECT_THAT(OpenToOthers(Path("data")), testing::IsEmpty());
  const Outcome jobs = Tessera(folder_.path(), {"jobs", "--coordinator", address_});
  EXPECT_EQ(jobs.exit_code, 0) << jobs.output;
}

TEST_F(AccessTest, InconsistentListenOptionsAreRefusedAtStart) {
  MakeKeys();
  const auto refused = [&](const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"--data", Path("data")};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Outcome outcome = Program(folder_.path(), TESSERAD_PROGRAM, all).Wait();
    EXPECT_EQ(outcome.exit_code, 2) << outcome.output;
    return outcome.output;
  };
  EXPECT_THAT(refused({"--listen", "0.0.0.0:0"}), HasSubstr("--insecure"));
  EXPECT_THAT(refused({"--listen", "0.0.0.0:0", "--token-file", Path("keys/tokens")}), HasSubstr("--tls-cert"));
  EXPECT_THAT(refused({"--metrics-listen", "0.0.0.0:0"}), HasSubstr("--open-metrics"));
  EXPECT_THAT(refused({"--listen", "unix:/" + std::string(200, 'x')}), HasSubstr("107"));
  std::ofstream(Path("keys/bad")) << "anna boss\n";
  EXPECT_THAT(refused({"--token-file", Path("keys/bad")}), HasSubstr("line 1"));
  const Outcome again = Tessera(folder_.path(), {"access", "token", Path("keys"), "anna:viewer"});
  EXPECT_EQ(again.exit_code, 3) << again.output;
  EXPECT_FALSE(fs::exists(Path("data/state.sqlite"))) << "nothing is begun";
}

}  // namespace
}  // namespace tessera::e2e
