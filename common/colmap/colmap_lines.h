// The lines and words of COLMAP's text files.
#pragma once

#include <charconv>
#include <cstdint>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap_entries.h"

namespace tessera {

// Reads a text line by line, with line numbers, and the words of the current line.
class ColmapLineReader {
 public:
  // Skips a byte order mark. Keeps a reference to `text`.
  ColmapLineReader(const std::string& text, std::string file) : text_(text), file_(std::move(file)) {
    if (text.starts_with("\xef\xbb\xbf")) at_ = 3;
  }

  bool Next() {
    if (at_ >= text_.size()) return false;
    size_t end = text_.find('\n', at_);
    if (end == std::string::npos) end = text_.size();
    word_ = at_;
    line_end_ = end;
    if (line_end_ > word_ && text_[line_end_ - 1] == '\r') --line_end_;
    at_ = end + 1;
    ++number_;
    return true;
  }
  // The next line that is no comment.
  bool NextContent() {
    while (Next()) {
      if (AtEnd() || text_[word_] != '#') return true;
    }
    return false;
  }
  // The next line that is neither blank nor a comment.
  bool NextEntry() {
    while (NextContent()) {
      if (!AtEnd()) return true;
    }
    return false;
  }
  bool AtEnd() {
    while (word_ < line_end_ && (text_[word_] == ' ' || text_[word_] == '\t')) ++word_;
    return word_ >= line_end_;
  }
  std::string Word() {
    if (AtEnd()) return "";
    const size_t begin = word_;
    while (word_ < line_end_ && text_[word_] != ' ' && text_[word_] != '\t') ++word_;
    return text_.substr(begin, word_ - begin);
  }
  // The rest of the line without blanks at its ends; image names may contain blanks.
  std::string Rest() {
    if (AtEnd()) return "";
    size_t end = line_end_;
    while (end > word_ && (text_[end - 1] == ' ' || text_[end - 1] == '\t')) --end;
    return text_.substr(std::exchange(word_, line_end_), end - word_);
  }
  template <class T>
  bool Number(T* out) {
    if (AtEnd()) return false;
    const char* end = text_.data() + line_end_;
    const auto [stop, error] = std::from_chars(text_.data() + word_, end, *out);
    if (error != std::errc() || (stop != end && *stop != ' ' && *stop != '\t')) return false;
    word_ = static_cast<size_t>(stop - text_.data());
    return true;
  }
  bool LastWordIsNumber() const {
    const auto is_blank = [&](size_t at) { return text_[at] == ' ' || text_[at] == '\t'; };
    size_t end = line_end_;
    while (end > word_ && is_blank(end - 1)) --end;
    size_t begin = end;
    while (begin > word_ && !is_blank(begin - 1)) --begin;
    double value = 0;
    const auto [stop, error] = std::from_chars(text_.data() + begin, text_.data() + end, value);
    return error == std::errc() && stop == text_.data() + end;
  }
  // The next word, for messages; does not consume it.
  std::string Peek() {
    if (AtEnd()) return "the end of the line";
    const size_t keep = word_;
    const std::string word = Word();
    word_ = keep;
    return absl::StrCat("'", word.substr(0, 40), "'");
  }
  // Where the reader is, to return to it.
  struct Cursor {
    size_t at = 0, word = 0, line_end = 0;
    int64_t number = 0;
  };
  Cursor cursor() const { return {at_, word_, line_end_, number_}; }
  void Return(const Cursor& to) {
    at_ = to.at;
    word_ = to.word;
    line_end_ = to.line_end;
    number_ = to.number;
  }
  int64_t number() const { return number_; }  // of the line, from 1
  ColmapLocation Location() const { return {file_, absl::StrCat("line ", number_)}; }

 private:
  const std::string& text_;
  std::string file_;
  size_t at_ = 0, word_ = 0, line_end_ = 0;
  int64_t number_ = 0;
};

}  // namespace tessera
