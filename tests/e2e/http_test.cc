// The page and its API with the real programs: TLS, tokens, files, and attacks that gRPC must not notice.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>
#undef _res  // a macro of <resolv.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <list>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/e2e/programs.h"
#include "tests/support/http_client.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;

class HttpPageTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
  // Starts tesserad with TLS, tokens and the page.
  void Serve() {
    for (const auto& arguments :
         std::vector<std::vector<std::string>>{{"access", "server", Path("keys"), "localhost"},
                                               {"access", "token", Path("keys"), "anna:submitter", "vera:viewer"}}) {
      const Outcome made = Tessera(folder_.path(), arguments);
      ASSERT_EQ(made.exit_code, 0) << made.output;
    }
    fs::create_directories(Path("scenes"));
    fs::copy(ToyCity(), Path("scenes/city"), fs::copy_options::recursive);
    program_ = std::make_unique<Program>(
        folder_.path(), TESSERAD_PROGRAM,
        std::vector<std::string>{"--listen", "localhost:0", "--listen", "unix:" + Path("socket"), "--http",
                                 "localhost:0", "--tls-cert", Path("keys/server.pem"), "--tls-key",
                                 Path("keys/server.key"), "--token-file", Path("keys/tokens"), "--scene-root",
                                 Path("scenes"), "--data", Path("data"), "--port-file", Path("address")});
    ASSERT_TRUE(WaitUntil([&] { return fs::exists(Path("address")) || !program_->Running(); }));
    std::istringstream lines(Content(Path("address")));
    std::getline(lines, address_);
    std::getline(lines, url_);
    ASSERT_TRUE(url_.starts_with("https://localhost:")) << url_ << program_->Output();
    url_.pop_back();  // the slash
  }
  std::string TokenOf(const std::string& name) const {
    std::string token = Content(Path("keys/" + name + ".token"));
    token.erase(token.find_last_not_of('\n') + 1);
    return token;
  }
  std::unique_ptr<httplib::Client> Browser() const {
    auto browser = std::make_unique<httplib::Client>(url_);
    browser->set_ca_cert_path(Path("keys/ca.pem"));
    browser->set_read_timeout(30);
    browser->set_keep_alive(true);
    return browser;
  }
  // The headers of a browser that has logged in.
  httplib::Headers LogIn(httplib::Client& browser, const std::string& name) const {
    const auto answer = browser.Post("/api/v1/session", httplib::Headers{{"X-Tessera", "1"}},
                                     "{\"token\":\"" + TokenOf(name) + "\"}", "application/json");
    if (!answer || answer->status != 200) return {};
    const std::string cookie = answer->get_header_value("Set-Cookie");
    EXPECT_THAT(cookie, HasSubstr("; Secure"));
    return {{"Cookie", cookie.substr(0, cookie.find(';'))}, {"X-Tessera", "1"}};
  }
  int StatusOf(const httplib::Result& answer) const { return answer ? answer->status : 0; }
  Outcome TesseraByToken(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--coordinator", address_, "--tls-ca", Path("keys/ca.pem"), "--token-file",
                                       Path("keys/anna.token")});
    return Tessera(folder_.path(), arguments);
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  std::unique_ptr<Program> program_;
  std::string address_, url_;
};

TEST_F(HttpPageTest, AJobFromLogInToItsFiles) {
  Serve();
  const auto browser = Browser();
  EXPECT_EQ(StatusOf(browser->Get("/")), 200);
  EXPECT_EQ(StatusOf(browser->Get("/api/v1/jobs")), 401);
  const httplib::Headers anna = LogIn(*browser, "anna"), vera = LogIn(*browser, "vera");
  ASSERT_FALSE(anna.empty());
  const std::string request =
      json({{"scenePath", Path("scenes/city")},
            {"settings", {{"tiles", 1}, {"methodSettings", {{"levels", {2}}, {"iterations", {3}}}}}}})
          .dump();
  EXPECT_EQ(StatusOf(browser->Post("/api/v1/jobs", vera, request, "application/json")), 403);
  const auto created = browser->Post("/api/v1/jobs", anna, request, "application/json");
  ASSERT_EQ(StatusOf(created), 200) << (created ? created->body : "no answer");
  EXPECT_EQ(json::parse(created->body)["name"], "jobs/1");
  const Program worker(folder_.path(), TESSERA_WORKER_PROGRAM,
                       {"--coordinator", "unix:" + Path("socket"), "--work", Path("work"), "--threads", "1"});
  // The stream ends with the job.
  std::string stream;
  const auto watched = browser->Get("/api/v1/jobs/1:watch", vera, [&](const char* bytes, size_t size) {
    stream.append(bytes, size);
    return true;
  });
  ASSERT_EQ(StatusOf(watched), 200);
  EXPECT_THAT(stream, HasSubstr("JOB_STATE_SUCCEEDED"));
  EXPECT_THAT(stream, HasSubstr("event: end"));
  const Outcome fetched = TesseraByToken({"fetch", "jobs/1", "--out", Path("out")});
  ASSERT_EQ(fetched.exit_code, 0) << fetched.output;
  for (const char* const name : {"mesh.ply", "report.json", "job.json"}) {
    const auto file = browser->Get("/files/jobs/1/" + std::string(name), vera);
    ASSERT_EQ(StatusOf(file), 200) << name;
    EXPECT_EQ(file->body, Content(Path("out/" + std::string(name)))) << name;
  }
  EXPECT_EQ(StatusOf(browser->Get("/files/jobs/1/../../../../etc/passwd", vera)), 404);
  // Revoking holds at once.
  ASSERT_EQ(Tessera(folder_.path(), {"access", "revoke", Path("keys"), "vera"}).exit_code, 0);
  EXPECT_TRUE(WaitUntil([&] { return StatusOf(browser->Get("/api/v1/jobs", vera)) == 401; }, 10));
  EXPECT_EQ(StatusOf(browser->Get("/api/v1/jobs", anna)), 200);
}

TEST_F(HttpPageTest, ARenewedCertificateIsUsed) {
  Serve();
  EXPECT_EQ(StatusOf(Browser()->Get("/")), 200);
  // Another authority, which the browser does not trust yet.
  const Outcome made = Tessera(folder_.path(), {"access", "server", Path("other"), "localhost"});
  ASSERT_EQ(made.exit_code, 0) << made.output;
  for (const char* const name : {"server.pem", "server.key"}) {
    fs::copy_file(Path("other/" + std::string(name)), Path("keys/" + std::string(name)),
                  fs::copy_options::overwrite_existing);
  }
  EXPECT_TRUE(WaitUntil([&] { return StatusOf(Browser()->Get("/")) == 0; }, 20));
  fs::copy_file(Path("other/ca.pem"), Path("keys/ca.pem"), fs::copy_options::overwrite_existing);
  EXPECT_EQ(StatusOf(Browser()->Get("/")), 200);
}

TEST_F(HttpPageTest, ConnectionsWithoutEndAreNotNoticed) {
  Serve();
  std::list<HttpConnection> connections;
  for (int i = 0; i < 1500; ++i) {
    connections.emplace_back(url_);
    connections.back().Send(i % 2 == 0 ? "\x16" : "GET / HTTP/1.1\r\n");  // a handshake that never ends; no TLS
  }
  const auto start = std::chrono::steady_clock::now();
  const Outcome listed = TesseraByToken({"jobs"});
  EXPECT_EQ(listed.exit_code, 0) << listed.output;
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), 10);
  connections.clear();
  EXPECT_TRUE(WaitUntil([&] { return StatusOf(Browser()->Get("/")) == 200; }, 30));
  program_->Signal(SIGTERM);
  EXPECT_EQ(program_->Wait().exit_code, 0);
}

TEST_F(HttpPageTest, NetworkAddressesNeedTlsAndTokens) {
  const auto refused = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"--data", Path("data"), "--http"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Program program(folder_.path(), TESSERAD_PROGRAM, arguments);
    return program.Wait();
  };
  EXPECT_EQ(refused({"0.0.0.0:0"}).exit_code, 2);
  EXPECT_EQ(refused({"nonsense"}).exit_code, 2);
  EXPECT_EQ(refused({"unix:/tmp/socket"}).exit_code, 2);
}

}  // namespace
}  // namespace tessera::e2e
