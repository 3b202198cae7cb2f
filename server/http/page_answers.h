// The page and its assets.
#pragma once

#include <string>

#include "server/web/web_message.h"

namespace tessera {

// `asset`: name below /assets/; empty: the page itself. If the program was built without the page, the page is a plain
// one that says what is missing. Thread-safe.
WebAnswer PageAnswer(const WebRequest& request, const std::string& asset);

}  // namespace tessera
