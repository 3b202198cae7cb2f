// The style sheet of report.html.
#pragma once

#include <string_view>

namespace tessera {

// CSS without the characters < and &: light and dark by the reader's setting, narrow screens, A4 paper.
std::string_view ReportStyle();

}  // namespace tessera
