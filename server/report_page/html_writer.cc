#include "server/report_page/html_writer.h"

#include <algorithm>
#include <array>

#include "common/base/printable.h"
#include "common/storage/xml_file.h"

namespace tessera {
namespace {

constexpr size_t kMaxTextBytes = 1000;
constexpr std::array<std::string_view, 3> kVoidElements = {"br", "img", "meta"};
constexpr std::array<std::string_view, 4> kInlineElements = {"b", "code", "small", "span"};  // no line end after them

bool IsIn(const auto& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

Html HtmlText(std::string_view text) {
  Html html;
  html.markup_ = EscapeMarkup(Prefix(text, kMaxTextBytes));
  if (text.size() > kMaxTextBytes) html.markup_ += " \xe2\x80\xa6";  // an ellipsis
  return html;
}

Html HtmlElement(std::string_view name, const HtmlAttributes& attributes, const Html& content) {
  Html html;
  std::string& to = html.markup_;
  to.append("<").append(name);
  for (const auto& [key, value] : attributes) {
    to.append(" ").append(key).append("=\"").append(EscapeMarkup(value)).append("\"");
  }
  if (IsIn(kVoidElements, name)) {
    to.append("/>");
  } else {
    to.append(">").append(content.markup()).append("</").append(name).append(">");
  }
  if (!IsIn(kInlineElements, name)) to.append("\n");
  return html;
}

std::string HtmlDocument(std::string_view title, std::string_view style, const Html& body) {
  const Html metas =
      HtmlElement("meta", {{"charset", "utf-8"}}) +
      HtmlElement("meta", {{"http-equiv", "Content-Security-Policy"},
                           {"content", "default-src 'none'; img-src data:; style-src 'unsafe-inline'"}}) +
      HtmlElement("meta", {{"name", "viewport"}, {"content", "width=device-width, initial-scale=1"}}) +
      HtmlElement("meta", {{"name", "color-scheme"}, {"content", "light dark"}}) +
      HtmlElement("title", HtmlText(title));
  std::string page = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n";
  page.append(metas.markup()).append("<style>\n").append(style).append("</style>\n</head>\n");
  return page.append(HtmlElement("body", body).markup()).append("</html>\n");
}

}  // namespace tessera
