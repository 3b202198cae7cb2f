// Sections of report.html below its pictures: plots and tables. Each is empty if there is nothing to show.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/report_page/html_writer.h"
#include "server/report_page/job_facts.h"
#include "server/report_page/report_facts.h"
#include "server/report_page/report_pictures.h"

namespace tessera {

// What the page shows, parsed.
struct PageFacts {
  ReportFacts report;
  std::optional<JobFacts> job;
  std::optional<ReportPictures> pictures;
  std::map<int, std::string> quarantined;  // tiles and reasons, which may be empty
};

// "28.1 %".
std::string PercentText(double share);
// 1234567 as "1,234,567".
std::string CountText(double count);
// "0.617 m".
std::string MetresText(double m);

Html WarningList(const PageFacts& facts);
// Energies, labels, distributions.
Html QualityPlots(const PageFacts& facts);
// Time and memory by kind of task, beside the predictions.
Html ResourcePlots(const PageFacts& facts);
// Of a job with several tiles.
Html TileTable(const PageFacts& facts);
Html SkippedImages(const PageFacts& facts);
// Two columns: name and value; rows without a value are left out.
Html FactTable(const std::vector<std::pair<std::string, Html>>& rows);

}  // namespace tessera
