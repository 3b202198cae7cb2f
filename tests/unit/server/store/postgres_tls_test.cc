// The state over TLS: sslmode and sslrootcert of the URL, as libpq reads them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "common/access/certificates.h"
#include "common/access/secrets.h"
#include "common/storage/files.h"
#include "server/store/state_store.h"
#include "tests/support/servers/postgres_database.h"
#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class PostgresTlsTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    const int64_t now_s = std::time(nullptr);
    const Certificate authority = *MakeAuthority({"the house", {}, now_s, -3600, 86400});
    const Certificate server = *MakeCertificate(authority, {"database", {"127.0.0.1"}, now_s, -3600, 86400});
    Write("ca.pem", authority.certificate_pem);
    Write("other.pem", MakeAuthority({"another house", {}, now_s, -3600, 86400})->certificate_pem);
    Write("server.pem", server.certificate_pem);
    ASSERT_TRUE(WriteSecretFile(PathOf("server.key"), server.key_pem).ok());
    if (::getuid() == 0) Run("chown -R postgres: " + folder_.path());
    Run("PG_OPTIONS='-c ssl=on -c ssl_cert_file=" + PathOf("server.pem") + " -c ssl_key_file=" + PathOf("server.key") +
        "' " + Script("start"));
    std::ifstream(PathOf("postgres/address")) >> url_;
    ASSERT_FALSE(url_.empty());
  }
  void TearDown() override {
    if (!url_.empty()) Run(Script("stop"));
  }
  std::string PathOf(const std::string& name) const { return folder_.path() + "/" + name; }
  std::string Script(const std::string& action) const {
    return std::string(TESSERA_START_POSTGRES) + " " + PathOf("postgres") + " " + action;
  }
  void Write(const std::string& name, const std::string& text) { std::ofstream(PathOf(name)) << text; }
  static void Run(const std::string& command) { ASSERT_EQ(std::system(command.c_str()), 0) << command; }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string url_;
};

TEST_F(PostgresTlsTest, StateIsStoredOverVerifiedConnections) {
  const std::string url = url_ + "?sslmode=verify-full&sslrootcert=" + PathOf("ca.pem");
  const auto store = OpenState(url, {.holder = "test"});
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_TRUE((*store)->Append({"one"}, Durability::kMachine).ok());
  EXPECT_THAT(AllRecords(**store), ElementsAre("one"));
  EXPECT_THAT(RunPostgres(url,
                          "SELECT DISTINCT ssl::text FROM pg_stat_ssl JOIN pg_stat_activity USING (pid)"
                          " WHERE usename = 'tessera'"),
              ElementsAre("true"));
}

TEST_F(PostgresTlsTest, CertificateOfAnotherAuthorityIsRefused) {
  const auto store = OpenState(url_ + "?sslmode=verify-full&sslrootcert=" + PathOf("other.pem"), {.holder = "test"});
  ASSERT_TRUE(absl::IsUnavailable(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("certificate verify failed"));
}

TEST_F(PostgresTlsTest, ServerWithoutTlsIsRefused) {
  const auto store = OpenState(ServerAddress("postgres") + "?sslmode=require", {.holder = "test"});
  ASSERT_TRUE(absl::IsUnavailable(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("SSL"));
}

}  // namespace
}  // namespace tessera
