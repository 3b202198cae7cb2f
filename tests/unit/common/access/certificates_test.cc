#include "common/access/certificates.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

// The coordinator's tests use the certificates for TLS.
TEST(Certificates, MakeCertificateRejectsInvalidAuthorities) {
  const auto authority = MakeAuthority({"an authority", {}, 1'800'000'000, -60, 86400});
  ASSERT_TRUE(authority.ok()) << authority.status();
  const auto server = MakeCertificate(*authority, {"s", {"city-server", "10.0.0.1", "::1"}, 1'800'000'000, 0, 3600});
  ASSERT_TRUE(server.ok()) << server.status();
  EXPECT_THAT(server->certificate_pem, testing::StartsWith("-----BEGIN CERTIFICATE-----"));
  EXPECT_THAT(server->key_pem, testing::StartsWith("-----BEGIN PRIVATE KEY-----"));
  EXPECT_EQ(MakeCertificate({authority->certificate_pem, server->key_pem}, {"c", {}, 0, 0, 1}).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MakeCertificate({"", ""}, {"c", {}, 0, 0, 1}).status().code(), absl::StatusCode::kInvalidArgument);
  for (const char* bad : {"", "a,DNS:b", "a b", "a\nb"}) {
    EXPECT_EQ(MakeCertificate(*authority, {"s", {bad}, 0, 0, 1}).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace tessera
