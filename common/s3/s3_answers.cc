#include "common/s3/s3_answers.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/time/time.h"
#include "common/storage/xml_file.h"

namespace tessera {
namespace {

constexpr char kAnswer[] = "the S3 store's answer";
constexpr size_t kMaxEntries = 10'000;  // of an answer; stores send at most 1,000
constexpr size_t kMaxTextBytes = 4096;

StatusOr<XmlFile> ParseAnswer(const std::string& xml, const std::string& root) {
  TESSERA_ASSIGN_OR_RETURN(XmlFile file, XmlFile::Parse(xml, kAnswer));
  if (file.Root().Name() != root) {
    Faults faults;
    file.Root().AddFault(absl::StrCat("<", std::string(file.Root().Name().substr(0, 100)), ">"),
                         absl::StrCat("<", root, ">"), &faults);
    return faults.ToStatus();
  }
  return file;
}

std::string TextOf(XmlNode parent, const char* name) {
  return std::string(parent.Child(name).Text().substr(0, kMaxTextBytes));
}

// Reads the values of an element; faults of all are collected.
class AnswerReader {
 public:
  AnswerReader(XmlNode node, Faults* faults) : node_(node), faults_(faults) {}

  std::string Text(const char* name) const {
    const XmlNode child = node_.Child(name);
    if (child.Text().empty()) node_.AddFault(absl::StrCat("no <", name, ">"), "one with a text", faults_);
    if (child.Text().size() > kMaxTextBytes) child.AddFault("a long text", absl::StrCat(kMaxTextBytes), faults_);
    return std::string(child.Text());
  }
  // Percent-decoded if `encoded`.
  std::string Key(bool encoded) const {
    const std::string text = Text("Key");
    return encoded ? Decode(text) : text;
  }
  int64_t Size() const {
    const std::optional<int64_t> size = node_.ChildInteger("Size", faults_);
    if (size && *size < 0) node_.AddFault(absl::StrCat(*size, " bytes"), "at least 0", faults_);
    return size.value_or(0);
  }
  int64_t Time(const char* name) const {
    const std::string text = Text(name);
    absl::Time time;
    std::string error;
    if (!text.empty() && !absl::ParseTime(absl::RFC3339_full, text, &time, &error)) {
      node_.Child(name).AddFault("no time", "such as 2013-05-24T00:00:00.000Z", faults_);
    }
    return absl::ToUnixMicros(time);
  }
  std::string Etag() const {
    const std::optional<std::string> etag = ParseEtag(Text("ETag"));
    if (!etag) node_.AddFault("a wrong <ETag>", "printable characters", faults_);
    return etag.value_or("");
  }

 private:
  std::string Decode(const std::string& text) const {
    std::string decoded;
    for (size_t i = 0; i < text.size(); ++i) {
      int byte = text[i] == '+' ? ' ' : text[i];
      if (text[i] == '%') {
        const auto digit = [&](size_t at) {
          const char c = at < text.size() ? text[at] : ' ';
          return c >= '0' && c <= '9'   ? c - '0'
                 : c >= 'A' && c <= 'F' ? c - 'A' + 10
                 : c >= 'a' && c <= 'f' ? c - 'a' + 10
                                        : -1;
        };
        const int high = digit(i + 1), low = digit(i + 2);
        if (high < 0 || low < 0) {
          node_.AddFault("a wrong percent-encoding", "% and two hex digits", faults_);
          return "";
        }
        byte = high * 16 + low;
        i += 2;
      }
      decoded.push_back(static_cast<char>(byte));
    }
    return decoded;
  }

  XmlNode node_;
  Faults* faults_;
};

bool IsTruncated(XmlNode root) { return root.Child("IsTruncated").Text() == "true"; }

S3ErrorAnswer ReadError(XmlNode error) {
  return {TextOf(error, "Code"), TextOf(error, "Message"), TextOf(error, "ServerTime"), TextOf(error, "Region"),
          TextOf(error, "Endpoint")};
}

}  // namespace

StatusOr<S3ErrorAnswer> ParseS3Error(const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, XmlFile::Parse(xml, kAnswer));
  XmlNode error = file.Root();
  if (error.Name() == "ErrorResponse") error = error.Child("Error");
  S3ErrorAnswer answer = ReadError(error);
  if (error.Name() != "Error" || answer.code.empty()) {
    Faults faults;
    file.Root().AddFault("no error with a code", "<Error><Code>", &faults);
    return faults.ToStatus();
  }
  return answer;
}

std::optional<S3ErrorAnswer> S3ErrorIn(const std::string& xml) {
  StatusOr<S3ErrorAnswer> error = ParseS3Error(xml);
  if (!error.ok()) return std::nullopt;
  return *std::move(error);
}

StatusOr<S3Page> ParseS3Listing(const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, ParseAnswer(xml, "ListBucketResult"));
  const XmlNode root = file.Root();
  const bool encoded = root.Child("EncodingType").Text() == "url";
  S3Page page;
  Faults faults;
  for (XmlNode node = root.Child("Contents"); node; node = node.Next("Contents")) {
    if (page.objects.size() >= kMaxEntries) {
      return InputError(kAnswer, "", "too many objects", absl::StrCat("at most ", kMaxEntries));
    }
    const AnswerReader reader(node, &faults);
    page.objects.push_back({reader.Key(encoded), reader.Size(), reader.Time("LastModified"), reader.Etag()});
  }
  if (IsTruncated(root)) page.next = AnswerReader(root, &faults).Text("NextContinuationToken");
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return page;
}

StatusOr<S3UploadPage> ParseS3Uploads(const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, ParseAnswer(xml, "ListMultipartUploadsResult"));
  const XmlNode root = file.Root();
  S3UploadPage page;
  Faults faults;
  for (XmlNode node = root.Child("Upload"); node; node = node.Next("Upload")) {
    if (page.uploads.size() >= kMaxEntries) {
      return InputError(kAnswer, "", "too many uploads", absl::StrCat("at most ", kMaxEntries));
    }
    const AnswerReader reader(node, &faults);
    page.uploads.push_back({reader.Key(false), reader.Text("UploadId"), reader.Time("Initiated")});
  }
  if (IsTruncated(root)) {
    page.next_key = AnswerReader(root, &faults).Text("NextKeyMarker");
    page.next_id = TextOf(root, "NextUploadIdMarker");
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return page;
}

StatusOr<std::string> ParseS3UploadId(const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, ParseAnswer(xml, "InitiateMultipartUploadResult"));
  Faults faults;
  std::string id = AnswerReader(file.Root(), &faults).Text("UploadId");
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return id;
}

StatusOr<std::string> ParseS3EtagOf(const std::string& root, const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, ParseAnswer(xml, root));
  Faults faults;
  std::string etag = AnswerReader(file.Root(), &faults).Etag();
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return etag;
}

StatusOr<std::vector<S3DeleteError>> ParseS3DeleteErrors(const std::string& xml) {
  TESSERA_ASSIGN_OR_RETURN(const XmlFile file, ParseAnswer(xml, "DeleteResult"));
  std::vector<S3DeleteError> errors;
  for (XmlNode node = file.Root().Child("Error"); node; node = node.Next("Error")) {
    if (errors.size() >= kMaxEntries) {
      return InputError(kAnswer, "", "too many errors", absl::StrCat("at most ", kMaxEntries));
    }
    errors.push_back({TextOf(node, "Key"), TextOf(node, "Code"), TextOf(node, "Message")});
  }
  return errors;
}

std::optional<std::string> ParseEtag(const std::string& text) {
  std::string etag = text;
  if (etag.starts_with("W/")) etag.erase(0, 2);
  if (etag.size() >= 2 && etag.front() == '"' && etag.back() == '"') etag = etag.substr(1, etag.size() - 2);
  const auto fits = [](char c) { return c > ' ' && c < 127 && c != '"'; };
  if (etag.empty() || etag.size() > 256 || !std::all_of(etag.begin(), etag.end(), fits)) return std::nullopt;
  return etag;
}

std::string EscapeS3Xml(const std::string& text) {
  return absl::StrReplaceAll(text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}});
}

}  // namespace tessera
