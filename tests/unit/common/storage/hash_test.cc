#include "common/storage/hash.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(Sha256Test, HexRoundTripAndMalformedHexIsRejected) {
  const std::string hex = Sha256Hex("tile");
  const auto sha256 = Sha256::FromHex(hex);
  ASSERT_TRUE(sha256);
  EXPECT_EQ(sha256->Hex(), hex);
  EXPECT_FALSE(*sha256 == *Sha256::FromHex(Sha256Hex("other")));
  EXPECT_EQ(Sha256().Hex(), std::string(64, '0'));
  std::string upper = hex;
  upper[63] = 'F';
  for (const std::string& bad : {std::string(), hex.substr(1), hex + "0", upper, hex.substr(1) + "g"}) {
    EXPECT_FALSE(Sha256::FromHex(bad)) << bad;
  }
}

}  // namespace
}  // namespace tessera
