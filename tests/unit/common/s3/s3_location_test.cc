#include "common/s3/s3_location.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(S3Location, ReadsUrls) {
  const StatusOr<S3Location> plain = ParseS3Url("s3://bucket", "http://host:8080/", "");
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_EQ(plain->bucket, "bucket");
  EXPECT_EQ(plain->prefix, "");
  EXPECT_EQ(plain->endpoint, "http://host:8080");
  EXPECT_EQ(plain->region, "us-east-1");
  const StatusOr<S3Location> amazon = ParseS3Url("s3://my.bucket/a/b", "", "eu-west-1");
  ASSERT_TRUE(amazon.ok()) << amazon.status();
  EXPECT_EQ(amazon->prefix, "a/b/");
  EXPECT_EQ(amazon->endpoint, "https://s3.eu-west-1.amazonaws.com");
  EXPECT_EQ(ToText(*amazon), "s3://my.bucket/a/b/");
  EXPECT_TRUE(IsS3Url("s3://x"));
  EXPECT_FALSE(IsS3Url("/s3://x"));
}

TEST(S3Location, LeavesOutTheSchemesOwnPort) {
  EXPECT_EQ(ParseS3Url("s3://bucket", "http://host:80", "")->endpoint, "http://host");
  EXPECT_EQ(ParseS3Url("s3://bucket", "https://host:443", "")->endpoint, "https://host");
  EXPECT_EQ(ParseS3Url("s3://bucket", "http://host:443", "")->endpoint, "http://host:443");
}

TEST(S3Location, RefusesWrongOnes) {
  for (const char* url :
       {"bucket", "http://bucket", "s3://", "s3://ab", "s3://Bucket", "s3://bucket_1", "s3://bucket-",
        "s3://bucket/a//b", "s3://bucket/../b", "s3://bucket/./b", "s3://bucket/a\nb", "s3://bucket/\xff"}) {
    EXPECT_EQ(ParseS3Url(url, "http://host", "").status().code(), absl::StatusCode::kInvalidArgument) << url;
  }
  for (const char* endpoint : {"host", "ftp://host", "http://", "http://host/path", "http://user@host", "http://a b",
                               "http://host?x", "http://host\n"}) {
    EXPECT_EQ(ParseS3Url("s3://bucket", endpoint, "").status().code(), absl::StatusCode::kInvalidArgument) << endpoint;
  }
  EXPECT_FALSE(ParseS3Url("s3://bucket", "http://host", "a/b").ok());
}

TEST(S3Location, KeysAreBounded) {
  EXPECT_TRUE(CheckS3Key("a/b c/ü+&<>").ok());
  EXPECT_FALSE(CheckS3Key("").ok());
  EXPECT_FALSE(CheckS3Key("/a").ok());
  EXPECT_FALSE(CheckS3Key("a\x7f").ok());
  EXPECT_FALSE(CheckS3Key(std::string(1025, 'a')).ok());
}

}  // namespace
}  // namespace tessera
