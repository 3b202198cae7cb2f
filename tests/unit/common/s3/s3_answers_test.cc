#include "common/s3/s3_answers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(S3Answers, ReadsErrorsOfAllStores) {
  const StatusOr<S3ErrorAnswer> plain = ParseS3Error(
      "<?xml version='1.0'?><Error><Code>RequestTimeTooSkewed</Code><Message>m &amp; n</Message>"
      "<ServerTime>2013-05-24T00:00:00Z</ServerTime></Error>");
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_EQ(plain->code, "RequestTimeTooSkewed");
  EXPECT_EQ(plain->message, "m & n");
  EXPECT_EQ(plain->server_time, "2013-05-24T00:00:00Z");
  EXPECT_EQ(ParseS3Error("<ErrorResponse><Error><Code>C</Code></Error></ErrorResponse>")->code, "C");
  EXPECT_FALSE(ParseS3Error("<Error><Message>no code</Message></Error>").ok());
  EXPECT_FALSE(ParseS3Error("").ok());
  EXPECT_FALSE(S3ErrorIn("<CopyObjectResult/>").has_value());
}

TEST(S3Answers, ReadsUploads) {
  const StatusOr<S3UploadPage> page = ParseS3Uploads(
      "<ListMultipartUploadsResult><IsTruncated>true</IsTruncated><NextKeyMarker>k</NextKeyMarker>"
      "<NextUploadIdMarker>i</NextUploadIdMarker><Upload><Key>a b</Key><UploadId>id</UploadId>"
      "<Initiated>2013-05-24T00:00:00.5Z</Initiated></Upload></ListMultipartUploadsResult>");
  ASSERT_TRUE(page.ok()) << page.status();
  ASSERT_EQ(page->uploads.size(), 1u);
  EXPECT_EQ(page->uploads[0].key, "a b");
  EXPECT_EQ(page->uploads[0].id, "id");
  EXPECT_EQ(page->uploads[0].started_us, int64_t{1'369'353'600'500} * 1000);
  EXPECT_EQ(page->next_key, "k");
  EXPECT_EQ(page->next_id, "i");
}

TEST(S3Answers, TellsAllFaultsOfAnAnswer) {
  const Status status = ParseS3Listing(
                            "<ListBucketResult><Contents><Key>%zz</Key><Size>-1</Size><ETag>a b</ETag>"
                            "<LastModified>yesterday</LastModified></Contents>"
                            "<EncodingType>url</EncodingType></ListBucketResult>")
                            .status();
  for (const char* word : {"percent-encoding", "-1 bytes", "<ETag>", "no time"}) {
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr(word));
  }
}

TEST(S3Answers, ReadsEtags) {
  EXPECT_EQ(ParseEtag("\"abc-2\""), "abc-2");
  EXPECT_EQ(ParseEtag("W/\"abc\""), "abc");
  EXPECT_EQ(ParseEtag("abc"), "abc");
  for (const char* wrong : {"", "\"\"", "a\"b", "a b", "a\r\nb", "\xc3\xbc"}) EXPECT_FALSE(ParseEtag(wrong)) << wrong;
}

}  // namespace
}  // namespace tessera
