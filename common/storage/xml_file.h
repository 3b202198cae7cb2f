// XML files from outside: bounded before parsing, and errors that name the file, the element and its position.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace pugi {
struct xml_node_struct;
}

namespace tessera {

inline constexpr int64_t kMaxXmlBytes = int64_t{2} << 30;
inline constexpr int kMaxXmlDepth = 64;  // nested elements

// `text` as content of an element or value of an attribute of XML or HTML. Control characters and bytes that are not
// UTF-8 are escaped as in Printable.
std::string EscapeMarkup(std::string_view text);

struct XmlDocument;

// An element of an XmlFile, which must outlive it, or no element. Functions of no element return no element, no
// attribute and empty text; their faults name the whole file.
//
// Functions with `faults` add a fault with file, place, found and expected for a value that is missing or wrong, and
// return nothing then. A file adds at most 1,000 faults. Numbers are at most 1e100 and do not depend on the locale. Not
// thread-safe.
class XmlNode {
 public:
  XmlNode() = default;
  XmlNode(const XmlDocument* document, pugi::xml_node_struct* node) : document_(document), node_(node) {}
  explicit operator bool() const { return node_ != nullptr; }
  std::string_view Name() const;
  // The first text in the element, without blanks around it.
  std::string_view Text() const;
  // The first child of this name; any name: nullptr.
  XmlNode Child(const char* name = nullptr) const;
  // The next sibling of this name; any name: nullptr.
  XmlNode Next(const char* name = nullptr) const;
  std::optional<std::string_view> Attribute(const char* name) const;
  // "/BlocksExchange/Block/Photogroups/Photogroup (line 12, byte 345)".
  std::string Location() const;
  void AddFault(const std::string& found, const std::string& expected, Faults* faults) const;

  // The text as a number, or as exactly values.size() numbers, separated by blanks.
  std::optional<double> Number(Faults* faults) const;
  std::optional<int64_t> Integer(Faults* faults) const;
  bool Numbers(std::span<double> values, Faults* faults) const;
  // The text of a child, which must exist; ...Or: `value` if the child does not exist or is wrong.
  std::optional<double> ChildNumber(const char* name, Faults* faults) const;
  double ChildNumberOr(const char* name, double value, Faults* faults) const;
  std::optional<int64_t> ChildInteger(const char* name, Faults* faults) const;
  // An attribute, which must exist.
  std::optional<double> NumberAttribute(const char* name, Faults* faults) const;
  std::optional<int64_t> IntegerAttribute(const char* name, Faults* faults) const;

 private:
  bool Missing(const char* kind, const char* name, Faults* faults) const;
  const XmlDocument* document_ = nullptr;
  pugi::xml_node_struct* node_ = nullptr;
};

// A parsed file. Movable.
class XmlFile {
 public:
  // `name`: the file's name in messages. INVALID_ARGUMENT with the line for text that is not well-formed UTF-8 XML,
  // above kMaxXmlBytes or kMaxXmlDepth, or with a document type that has an internal subset, in which entities are
  // declared. Further elements may follow the first, as in files of tie points. Uses at most 32 times the text's size.
  static StatusOr<XmlFile> Parse(std::string text, const std::string& name);
  XmlFile(XmlFile&&) noexcept;
  XmlFile& operator=(XmlFile&&) noexcept;
  ~XmlFile();
  XmlNode Root() const;  // the first element

 private:
  explicit XmlFile(std::unique_ptr<XmlDocument> document);
  std::unique_ptr<XmlDocument> document_;
};

// The name of the first element in `head`, the first bytes of a file; empty if there is none.
std::string XmlRootName(std::string_view head);

}  // namespace tessera
