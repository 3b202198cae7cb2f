#include "common/storage/xml_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "common/base/printable.h"

namespace tessera {

std::string EscapeMarkup(std::string_view text) {
  return absl::StrReplaceAll(Printable(text),
                             {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}, {"'", "&#39;"}});
}

struct XmlDocument {
  std::string name;
  std::string text;  // pugixml parses it in place and keeps pointers into it
  pugi::xml_document document;
  // For faults: their number, and the last position whose line was counted.
  mutable int faults = 0;
  mutable size_t counted_to = 0;
  mutable int64_t lines_before = 0;
};

namespace {

constexpr int kMaxXmlFaults = 1000;
constexpr double kMaxNumber = 1e100;  // products of some numbers are finite too
constexpr std::string_view kXmlBlanks = " \t\r\n";

std::string QuotedXml(std::string_view text) {
  return absl::StrCat("'", Printable(Prefix(text, 60)), text.size() > 60 ? "..." : "", "'");
}

std::string_view TrimXml(std::string_view text) {
  const size_t begin = text.find_first_not_of(kXmlBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kXmlBlanks) - begin + 1);
}

// The whole word as a number.
template <class Value>
bool ParseXmlNumber(std::string_view word, Value* value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), *value);
  return error == std::errc() && stop == word.data() + word.size() &&
         std::abs(static_cast<double>(*value)) <= kMaxNumber;
}

std::string LineOf(std::string_view text, size_t at) {
  return absl::StrCat("line ", 1 + std::count(text.begin(), text.begin() + std::min(at, text.size()), '\n'));
}

// The position after the tag that begins at `at`; npos if it does not end.
size_t EndOfTag(std::string_view text, size_t at) {
  while (true) {
    at = text.find_first_of("\"'>", at);
    if (at == std::string_view::npos) return at;
    if (text[at] == '>') return at + 1;
    at = text.find(text[at], at + 1);
    if (at == std::string_view::npos) return at;
    ++at;
  }
}

// Skips a comment, CDATA section or processing instruction at `at`. False if there is none.
bool SkipXmlSection(std::string_view text, size_t* at) {
  for (const auto& [begin, end] :
       {std::pair<std::string_view, std::string_view>{"<!--", "-->"}, {"<![CDATA[", "]]>"}, {"<?", "?>"}}) {
    if (text.substr(*at, begin.size()) != begin) continue;
    const size_t stop = text.find(end, *at + begin.size());
    *at = stop == std::string_view::npos ? text.size() : stop + end.size();
    return true;
  }
  return false;
}

// Bounds before parsing. Text that is not well-formed passes; the parser refuses it.
Status CheckXmlBounds(std::string_view text, const std::string& name) {
  if (text.size() > static_cast<size_t>(kMaxXmlBytes)) {
    return InputError(name, "", absl::StrCat(text.size(), " bytes"), absl::StrCat("at most ", kMaxXmlBytes, " bytes"));
  }
  if (const size_t zero = text.find('\0'); zero != std::string_view::npos) {
    return InputError(name, absl::StrCat("byte ", zero), "a zero byte, as in binary files and UTF-16", "XML in UTF-8");
  }
  if (!IsUtf8(text)) return InputError(name, "", "bytes that are not UTF-8", "XML in UTF-8");
  int depth = 0;
  for (size_t at = text.find('<'); at < text.size(); at = text.find('<', at)) {
    if (SkipXmlSection(text, &at)) continue;
    const size_t begin = at;
    if (text.substr(at, 2) == "<!") {
      at = text.find_first_of("[>", at);
      if (at != std::string_view::npos && text[at] == '[') {
        return InputError(name, LineOf(text, begin), "a document type with declarations, such as entities",
                          "XML without them");
      }
      continue;
    }
    at = EndOfTag(text, at);
    if (text.substr(begin, 2) == "</") {
      --depth;
    } else if (at != std::string_view::npos && text[at - 2] != '/' && ++depth > kMaxXmlDepth) {
      return InputError(name, LineOf(text, begin), absl::StrCat("elements nested deeper than ", kMaxXmlDepth),
                        absl::StrCat("a depth of at most ", kMaxXmlDepth));
    }
  }
  return absl::OkStatus();
}

bool HasName(pugi::xml_node node, const char* name) {
  return node.type() == pugi::node_element && (name == nullptr || std::string_view(node.name()) == name);
}

}  // namespace

std::string_view XmlNode::Name() const { return pugi::xml_node(node_).name(); }

std::string_view XmlNode::Text() const { return TrimXml(pugi::xml_node(node_).child_value()); }

XmlNode XmlNode::Child(const char* name) const {
  for (pugi::xml_node child : pugi::xml_node(node_).children()) {
    if (HasName(child, name)) return {document_, child.internal_object()};
  }
  return {document_, nullptr};
}

XmlNode XmlNode::Next(const char* name) const {
  for (pugi::xml_node next = pugi::xml_node(node_).next_sibling(); next; next = next.next_sibling()) {
    if (HasName(next, name)) return {document_, next.internal_object()};
  }
  return {document_, nullptr};
}

std::optional<std::string_view> XmlNode::Attribute(const char* name) const {
  const pugi::xml_attribute attribute = pugi::xml_node(node_).attribute(name);
  if (!attribute) return std::nullopt;
  return TrimXml(attribute.value());
}

std::string XmlNode::Location() const {
  if (node_ == nullptr) return "";
  std::vector<std::string> names;
  for (pugi::xml_node node(node_); node.type() == pugi::node_element; node = node.parent()) {
    names.push_back(Printable(node.name()));
  }
  std::reverse(names.begin(), names.end());
  // The parser overwrites a line end that directly follows the name of a tag; the line is too small then.
  const size_t at = std::max<ptrdiff_t>(pugi::xml_node(node_).offset_debug(), 0);
  if (at < document_->counted_to) document_->counted_to = 0, document_->lines_before = 0;
  const auto text = document_->text.begin();
  document_->lines_before += std::count(text + document_->counted_to, text + at, '\n');
  document_->counted_to = at;
  return absl::StrCat("/", absl::StrJoin(names, "/"), " (line ", document_->lines_before + 1, ", byte ", at, ")");
}

void XmlNode::AddFault(const std::string& found, const std::string& expected, Faults* faults) const {
  if (document_ == nullptr || document_->faults > kMaxXmlFaults) return;
  if (++document_->faults > kMaxXmlFaults) {
    faults->Add(InputError(document_->name, "", absl::StrCat("more than ", kMaxXmlFaults, " faults"), "none"));
  } else {
    faults->Add(InputError(document_->name, Location(), found, expected));
  }
}

std::optional<double> XmlNode::Number(Faults* faults) const {
  double value = 0;
  if (ParseXmlNumber(Text(), &value)) return value;
  AddFault(QuotedXml(Text()), "a number", faults);
  return std::nullopt;
}

std::optional<int64_t> XmlNode::Integer(Faults* faults) const {
  int64_t value = 0;
  if (ParseXmlNumber(Text(), &value)) return value;
  AddFault(QuotedXml(Text()), "a whole number", faults);
  return std::nullopt;
}

bool XmlNode::Numbers(std::span<double> values, Faults* faults) const {
  std::string_view rest = Text();
  for (double& value : values) {
    const std::string_view word = rest.substr(0, rest.find_first_of(kXmlBlanks));
    rest = TrimXml(rest.substr(word.size()));
    if (ParseXmlNumber(word, &value)) continue;
    AddFault(QuotedXml(Text()), absl::StrCat(values.size(), " numbers"), faults);
    return false;
  }
  if (!rest.empty()) AddFault(QuotedXml(Text()), absl::StrCat(values.size(), " numbers"), faults);
  return rest.empty();
}

bool XmlNode::Missing(const char* kind, const char* name, Faults* faults) const {
  AddFault(absl::StrCat("no ", kind, " ", name), "one", faults);
  return true;
}

std::optional<double> XmlNode::ChildNumber(const char* name, Faults* faults) const {
  const XmlNode child = Child(name);
  if (!child && Missing("element", name, faults)) return std::nullopt;
  return child.Number(faults);
}

double XmlNode::ChildNumberOr(const char* name, double value, Faults* faults) const {
  const XmlNode child = Child(name);
  return child ? child.Number(faults).value_or(value) : value;
}

std::optional<int64_t> XmlNode::ChildInteger(const char* name, Faults* faults) const {
  const XmlNode child = Child(name);
  if (!child && Missing("element", name, faults)) return std::nullopt;
  return child.Integer(faults);
}

std::optional<double> XmlNode::NumberAttribute(const char* name, Faults* faults) const {
  const std::optional<std::string_view> text = Attribute(name);
  if (!text && Missing("attribute", name, faults)) return std::nullopt;
  double value = 0;
  if (ParseXmlNumber(*text, &value)) return value;
  AddFault(absl::StrCat(name, "=", QuotedXml(*text)), "a number", faults);
  return std::nullopt;
}

std::optional<int64_t> XmlNode::IntegerAttribute(const char* name, Faults* faults) const {
  const std::optional<std::string_view> text = Attribute(name);
  if (!text && Missing("attribute", name, faults)) return std::nullopt;
  int64_t value = 0;
  if (ParseXmlNumber(*text, &value)) return value;
  AddFault(absl::StrCat(name, "=", QuotedXml(*text)), "a whole number", faults);
  return std::nullopt;
}

XmlFile::XmlFile(std::unique_ptr<XmlDocument> document) : document_(std::move(document)) {}
XmlFile::XmlFile(XmlFile&&) noexcept = default;
XmlFile& XmlFile::operator=(XmlFile&&) noexcept = default;
XmlFile::~XmlFile() = default;

StatusOr<XmlFile> XmlFile::Parse(std::string text, const std::string& name) {
  TESSERA_RETURN_IF_ERROR(CheckXmlBounds(text, name));
  auto document = std::make_unique<XmlDocument>();
  document->name = name;
  document->text = std::move(text);
  // Text is kept in its element, which halves the memory of files of numbers.
  constexpr unsigned kOptions = pugi::parse_cdata | pugi::parse_escapes | pugi::parse_embed_pcdata;
  const pugi::xml_parse_result result = document->document.load_buffer_inplace(
      document->text.data(), document->text.size(), kOptions, pugi::encoding_utf8);
  if (!result) {
    return InputError(name, LineOf(document->text, std::max<ptrdiff_t>(result.offset, 0)),
                      absl::StrCat("text that is not well-formed: ", result.description()),
                      "XML; the file may be cut off");
  }
  return XmlFile(std::move(document));
}

XmlNode XmlFile::Root() const { return XmlNode(document_.get(), document_->document.internal_object()).Child(); }

std::string XmlRootName(std::string_view head) {
  for (size_t at = head.find('<'); at < head.size(); at = head.find('<', at)) {
    if (SkipXmlSection(head, &at)) continue;
    if (head.substr(at, 2) == "<!") {
      at = EndOfTag(head, at);
      continue;
    }
    const std::string_view name = head.substr(at + 1);
    return std::string(name.substr(0, name.find_first_of(" \t\r\n/>")));
  }
  return "";
}

}  // namespace tessera
