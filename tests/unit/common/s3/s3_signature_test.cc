// The examples that AWS publishes for Signature Version 4 of S3.
#include "common/s3/s3_signature.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/hash.h"

namespace tessera {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;

constexpr int64_t kExampleUs = int64_t{1'369'353'600} * 1'000'000;  // 2013-05-24 00:00:00 UTC
constexpr char kExampleRegion[] = "us-east-1";

S3Credentials ExampleCredentials() {
  return {"AKIAIOSFODNN7EXAMPLE", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY", "", 0};
}

S3Request ExampleRequest(const std::string& method, const std::string& path) {
  S3Request request;
  request.method = method;
  request.host = "examplebucket.s3.amazonaws.com";
  request.path = path;
  return request;
}

std::string ExampleAuthorization(const S3Request& request) {
  return SignedHeaders(request, ExampleCredentials(), kExampleRegion, kExampleUs)["authorization"];
}

TEST(S3Signature, SignsTheExampleOfGetObject) {
  S3Request request = ExampleRequest("GET", "/test.txt");
  request.headers["range"] = "bytes=0-9";
  EXPECT_EQ(ExampleAuthorization(request),
            "AWS4-HMAC-SHA256 Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/aws4_request,"
            "SignedHeaders=host;range;x-amz-content-sha256;x-amz-date,"
            "Signature=f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41");
}

TEST(S3Signature, SignsTheExampleOfPutObject) {
  S3Request request = ExampleRequest("PUT", "/" + EncodeUri("test$file.text", true));
  request.headers["date"] = "Fri, 24 May 2013 00:00:00 GMT";
  request.headers["x-amz-storage-class"] = "REDUCED_REDUNDANCY";
  request.content_sha256 = Sha256Hex("Welcome to Amazon S3.");
  EXPECT_THAT(ExampleAuthorization(request),
              EndsWith("Signature=98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd"));
}

TEST(S3Signature, SignsTheExampleOfAQueryWithoutValue) {
  S3Request request = ExampleRequest("GET", "/");
  request.query["lifecycle"] = "";
  EXPECT_THAT(ExampleAuthorization(request),
              EndsWith("Signature=fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543"));
}

TEST(S3Signature, SignsTheExampleOfListObjects) {
  S3Request request = ExampleRequest("GET", "/");
  request.query = {{"prefix", "J"}, {"max-keys", "2"}};
  EXPECT_THAT(ExampleAuthorization(request),
              EndsWith("Signature=34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7"));
}

TEST(S3Signature, SignsTheExampleOfASignedUrl) {
  S3Request request = ExampleRequest("GET", "/test.txt");
  request.content_sha256 = kUnsignedPayload;
  EXPECT_EQ(SignedQuery(request, ExampleCredentials(), kExampleRegion, kExampleUs, 86400),
            "X-Amz-Algorithm=AWS4-HMAC-SHA256&X-Amz-Credential=AKIAIOSFODNN7EXAMPLE%2F20130524%2Fus-east-1%2Fs3%2F"
            "aws4_request&X-Amz-Date=20130524T000000Z&X-Amz-Expires=86400&X-Amz-SignedHeaders=host&"
            "X-Amz-Signature=aeeed9bbccd4d02ee5c0109b86d86835f995330da4c265957d157751f604d404");
}

TEST(S3Signature, SendsTheSessionToken) {
  S3Credentials credentials = ExampleCredentials();
  credentials.session_token = "a/token+";
  const S3Request request = ExampleRequest("GET", "/test.txt");
  const HttpHeaders headers = SignedHeaders(request, credentials, kExampleRegion, kExampleUs);
  EXPECT_EQ(headers.at("x-amz-security-token"), "a/token+");
  EXPECT_THAT(headers.at("authorization"), HasSubstr("x-amz-date;x-amz-security-token,"));
  EXPECT_THAT(SignedQuery(request, credentials, kExampleRegion, kExampleUs, 60),
              HasSubstr("&X-Amz-Security-Token=a%2Ftoken%2B&"));
}

TEST(S3Signature, TheSecretKeyIsInNoHeader) {
  for (const auto& [name, value] :
       SignedHeaders(ExampleRequest("GET", "/"), ExampleCredentials(), kExampleRegion, kExampleUs)) {
    EXPECT_THAT(value, Not(HasSubstr("wJalrXUtnFEMI")));
  }
}

TEST(S3Signature, EncodesAllButUnreservedCharacters) {
  EXPECT_EQ(EncodeUri("a/ü b+&=~-._", true), "a/%C3%BC%20b%2B%26%3D~-._");
  EXPECT_EQ(EncodeUri("a/b", false), "a%2Fb");
}

}  // namespace
}  // namespace tessera
