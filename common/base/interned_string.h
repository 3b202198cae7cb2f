// Interned strings, for values that are stored many times: task kinds, worker names, file names.
#pragma once

#include <boost/flyweight.hpp>
#include <concepts>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>

namespace tessera {

// A constant string of the size of a pointer. Equal strings of the process share one reference-counted buffer.
// Construction and copies take an internal lock; otherwise as thread-safe as std::string.
class InternedString {
 public:
  InternedString() = default;
  InternedString(std::string text) : text_(std::move(text)) {}  // NOLINT(google-explicit-constructor)
  InternedString(const char* text) : text_(text) {}             // NOLINT(google-explicit-constructor)

  const std::string& str() const { return text_.get(); }
  operator const std::string&() const { return str(); }  // NOLINT(google-explicit-constructor)

  friend bool operator==(const InternedString& a, const InternedString& b) { return a.text_ == b.text_; }
  template <std::convertible_to<std::string_view> Text>
  friend bool operator==(const InternedString& a, const Text& b) {
    return a.str() == std::string_view(b);
  }
  friend std::ostream& operator<<(std::ostream& out, const InternedString& text) { return out << text.str(); }

 private:
  boost::flyweight<std::string> text_;
};

}  // namespace tessera
