// Parses requests and writes answers as HTTP/1.1, by cpp-httplib.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/web/connections.h"
#include "server/web/web_message.h"

namespace tessera {

// Thread-safe.
class HttpMessages {
 public:
  // nullopt: no answer.
  using Answerer = std::function<std::optional<WebAnswer>(const WebRequest& request)>;

  // `keep_s`: how long an idle connection is kept, for the header of answers.
  explicit HttpMessages(double keep_s);
  ~HttpMessages();

  // As RequestHandler::Serve; nullopt if `answerer` gives no answer: then nothing was written.
  std::optional<bool> Serve(ReceivedRequest request, AnswerOutput& output, const Answerer& answerer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A whole answer that ends the connection.
std::string PlainAnswer(const WebAnswer& answer);

}  // namespace tessera
