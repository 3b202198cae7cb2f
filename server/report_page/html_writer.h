// HTML whose text is always escaped.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tessera {

// Markup of a page. Only the functions of this file make it, so text from outside never becomes markup.
class Html {
 public:
  Html() = default;
  const std::string& markup() const { return markup_; }
  bool empty() const { return markup_.empty(); }
  Html& operator+=(const Html& other) {
    markup_ += other.markup_;
    return *this;
  }
  friend Html operator+(Html a, const Html& b) { return a += b; }

 private:
  friend Html HtmlText(std::string_view text);
  friend Html HtmlElement(std::string_view name, const std::vector<std::pair<std::string, std::string>>& attributes,
                          const Html& content);
  std::string markup_;
};

using HtmlAttributes = std::vector<std::pair<std::string, std::string>>;

// `text` with &, <, >, " and ' as character references. Control characters, characters that change the direction of
// text, and bytes that are not UTF-8 are shown as Printable shows them. A text longer than 1,000 bytes is cut.
Html HtmlText(std::string_view text);

// An element; values of attributes are escaped as by HtmlText, but not cut. `name` and the names of attributes are
// constants of the program. Well-formed as HTML and as XML.
Html HtmlElement(std::string_view name, const HtmlAttributes& attributes, const Html& content = {});
inline Html HtmlElement(std::string_view name, const Html& content) { return HtmlElement(name, {}, content); }

// A whole document without scripts. Its Content-Security-Policy permits inline styles and data: pictures, and nothing
// else. `style`: CSS without the characters < and &, a constant of the program.
std::string HtmlDocument(std::string_view title, std::string_view style, const Html& body);

}  // namespace tessera
