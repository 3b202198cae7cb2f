#include "server/report_page/report_page.h"

#include <gmock/gmock.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "server/report_page/job_facts.h"
#include "tests/unit/server/report_page/page_fixtures.h"

namespace tessera {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

ReportPageInputs SmallPage() {
  ReportPageInputs inputs;
  inputs.report_json = kPageReport;
  inputs.job_json = kPageJob;
  inputs.created = "2026-11-26 05:00 UTC";
  inputs.finished = "2026-11-26 05:36 UTC";
  inputs.mesh_sha256 = std::string(64, 'a');
  inputs.program_version = "1.2.3";
  inputs.command = "tessera run /srv/cities/old-town --base=jobs/3 --out OUT";
  inputs.update_summary = "update of jobs/3: 1 of 2 tiles refined";
  inputs.source = {{"Coordinate system of the source", "EPSG:32633+5773"}};
  ReportPictures pictures;
  pictures.start_shaded = "jpeg 1";
  pictures.start_labels = "jpeg 2";
  pictures.shaded = "jpeg 3";
  pictures.labels = "jpeg 4";
  pictures.displacement = "jpeg 5";
  pictures.confidence = "jpeg 6";
  pictures.width_px = 760;
  pictures.height_px = 500;
  pictures.displacement_range_m = 1;
  pictures.confidence_shares = Distribution{0, 1, {0.25, 0.75}};
  pictures.displacement_shares = Distribution{-2, 2, {0.5, 0.5}};
  pictures.area_m2 = 26316;
  pictures.plan_area_m2 = 12100;
  pictures.mean_confidence = 0.875;
  pictures.unseen_share = 0.03;
  pictures.classes = {{"ground", std::array<uint8_t, 3>{128, 128, 128}},
                      {"roof", std::array<uint8_t, 3>{235, 196, 60}}};
  inputs.pictures = pictures;
  return inputs;
}

TEST(ReportPage, ShowsFiguresOfReportAndJob) {
  const std::string page = MakeReportPage(SmallPage());
  const std::string text = PageText(ParsePage(page));
  for (const char* figure : {"old town",
                             "jobs/7",
                             "spring",
                             "finished 2026-11-26 05:36 UTC",
                             "partial",  // title
                             "251,210",
                             "start mesh: 125,482",
                             "125,971",
                             "50",
                             "1 left out",
                             "12.5 cm",  // mesh
                             "26,316 m\xc2\xb2",
                             "12,100 m\xc2\xb2",
                             "1 quarantined",  //
                             "0.617 m",
                             "median 0.393 m, 90 % below 1 m, largest 3.19 m",  // displacement
                             "42,161",
                             "16.8 % of the faces",
                             "0.875",
                             "3.0 % of the area is in no image",  // labels
                             "95.1 %",
                             "start: 95.3 %, of 5,424",
                             "of 14,776 values",
                             "4 min 13 s",
                             "4 s",  // fit, seams, time
                             "62.5 %  (70.0 %)",
                             "4 s  (4)",
                             "200 MiB  (300)",
                             "28,109",
                             "40,480",  // plots
                             "0.0924",
                             "0.0858",
                             "round 2",
                             "quarantined no memory",
                             "95.0 % \xe2\x86\x92 96.0 %",  // energies, tiles
                             "the poses are off by 2 px",
                             "disk is slow",
                             "0007.jpg",
                             "no such file",  // warnings, images
                             "semantic",
                             "1.5",
                             "levels",
                             "[2,1,0]",
                             "EPSG:32633+5773",
                             "21",
                             "jobs/3",  // settings, provenance
                             "update of jobs/3: 1 of 2 tiles refined",
                             "--base=jobs/3 --out OUT",
                             "tessera 1.2.3"}) {
    EXPECT_THAT(text, HasSubstr(figure));
  }
  EXPECT_THAT(text, HasSubstr(std::string(64, 'a')));
  EXPECT_EQ(MakeReportPage(SmallPage()), page) << "the same bytes again";
}

TEST(ReportPage, EnergiesAreMeansByPixels) {
  const std::string text = PageText(ParsePage(MakeReportPage(SmallPage())));
  EXPECT_THAT(text, HasSubstr("0.0924")) << "(100 x .0934 + 300 x .0921) / 400";
}

TEST(ReportPage, WarningsOfReportAndJobAreShownOnce) {
  const std::string page = MakeReportPage(SmallPage());
  const size_t first = page.find("off by 2 px");
  ASSERT_NE(first, std::string::npos);
  EXPECT_EQ(page.find("off by 2 px", first + 1), std::string::npos);
}

TEST(ReportPage, HoldsItsPicturesAndReadsNothing) {
  const std::string page = MakeReportPage(SmallPage());
  const pugi::xml_document document = ParsePage(page);
  const pugi::xpath_node_set pictures = document.select_nodes("//img");
  ASSERT_EQ(pictures.size(), 6u);
  EXPECT_STREQ(pictures[0].node().attribute("src").value(), "data:image/jpeg;base64,anBlZyAx");
  EXPECT_TRUE(document.select_nodes("//script|//link|//iframe|//a|//form|//object").empty());
  EXPECT_THAT(page, Not(HasSubstr("url(")));
  for (const pugi::xpath_node& attribute : document.select_nodes("//@*")) {
    EXPECT_FALSE(std::string(attribute.attribute().name()).starts_with("on")) << "an event handler";
  }
}

TEST(ReportPage, ABadFitIsSaidFirst) {
  ReportPageInputs inputs = SmallPage();
  json report = json::parse(kPageReport);
  EXPECT_THAT(MakeReportPage(inputs), Not(HasSubstr("fits the images worse")));
  report["fit_change"]["worse"] = true;
  inputs.report_json = report.dump();
  const std::string page = MakeReportPage(inputs);
  EXPECT_LT(page.find("fits the images worse"), page.find("Faces"));
}

TEST(ReportPage, MissingPartsGiveAShorterPage) {
  const std::string whole = MakeReportPage(SmallPage());
  const json report = json::parse(kPageReport), job = json::parse(kPageJob);
  for (const auto& [key, value] : report.items()) {
    ReportPageInputs inputs = SmallPage();
    json part = report;
    part.erase(key);
    inputs.report_json = part.dump();
    const std::string page = MakeReportPage(inputs);
    ParsePage(page);
    EXPECT_LE(page.size(), whole.size() + 20) << key;
  }
  for (const auto& [key, value] : job.items()) {
    ReportPageInputs inputs = SmallPage();
    json part = job;
    part.erase(key);
    const std::string text = part.dump();
    inputs.job_json = text;
    ParsePage(MakeReportPage(inputs));
  }
  ReportPageInputs inputs = SmallPage();
  inputs.pictures.reset();
  inputs.no_pictures = "The mesh cannot be drawn: no mesh";
  const std::string page = MakeReportPage(inputs);
  EXPECT_THAT(PageText(ParsePage(page)), HasSubstr("The mesh cannot be drawn: no mesh"));
  EXPECT_THAT(page, Not(HasSubstr("<img")));
  for (const char* text : {"", "{", "[]", "null", "{\"tiles\": 3, \"output\": [1]}"}) {
    inputs = ReportPageInputs();
    inputs.report_json = text;
    inputs.job_json = text;
    ParsePage(MakeReportPage(inputs));
  }
}

// Replaces every value in turn by one of another type.
void ForEachChange(const json& whole, const std::function<void(const std::string&)>& use) {
  const json flat = whole.flatten();
  for (const auto& [pointer, value] : flat.items()) {
    for (const json& other : {json("text"), json(-1e300), json(json::array({1, json::object()})), json(nullptr)}) {
      json changed = whole;
      changed[json::json_pointer(pointer)] = other;
      use(changed.dump());
    }
  }
}

TEST(ReportPage, WrongTypesAreLeftOut) {
  ReportPageInputs inputs = SmallPage();
  inputs.pictures.reset();
  ForEachChange(json::parse(kPageReport), [&](const std::string& text) {
    inputs.report_json = text;
    ParsePage(MakeReportPage(inputs));
  });
  inputs.report_json = kPageReport;
  ForEachChange(json::parse(kPageJob), [&](const std::string& text) {
    inputs.job_json = text;
    ParsePage(MakeReportPage(inputs));
  });
}

// Puts `text` into all texts of the value, and into the names of members that come from outside.
json WithText(const json& value, const std::string& text) {
  if (value.is_string()) return text;
  if (value.is_array()) {
    json list = json::array();
    for (const json& item : value) list.push_back(WithText(item, text));
    return list;
  }
  if (!value.is_object()) return value;
  json object = json::object();
  for (const auto& [key, item] : value.items()) {
    object[key == "ground" || key == "semantic" ? text : key] = WithText(item, text);
  }
  return object;
}

TEST(ReportPage, HostileTextStaysText) {
  for (const std::string hostile : {"<img src=x onerror=alert(1)>", "</title><script>alert(1)</script>",
                                    "\"><b onclick='x'>", "]]>--><!--", "&lt;b&gt;"}) {
    ReportPageInputs inputs = SmallPage();
    inputs.report_json = WithText(json::parse(kPageReport), hostile).dump();
    const std::string job = WithText(json::parse(kPageJob), hostile).dump();
    inputs.job_json = job;
    inputs.update_summary = inputs.scene_name = inputs.created = inputs.finished = inputs.mesh_sha256 = hostile;
    inputs.program_version = inputs.command = inputs.no_pictures = inputs.pictures->no_start = hostile;
    inputs.source = {{hostile, hostile}};
    for (ReportClass& c : inputs.pictures->classes) c.name = hostile;
    const std::string page = MakeReportPage(inputs);
    const pugi::xml_document document = ParsePage(page);
    EXPECT_EQ(document.select_nodes("//img").size(), 6u);
    EXPECT_TRUE(document.select_nodes("//script").empty());
    EXPECT_EQ(page.find(hostile), std::string::npos) << "unescaped";
    // The scene, the job, a class, a warning, an image, the reason of a tile, a setting.
    const std::string text = PageText(document);
    size_t times = 0;
    for (size_t at = text.find(hostile); at != std::string::npos; at = text.find(hostile, at + 1)) ++times;
    EXPECT_GE(times, 15u) << "it is shown";
  }
}

TEST(ReportPage, BytesThatAreNotUtf8AreShown) {
  ReportPageInputs inputs = SmallPage();
  inputs.scene_name = inputs.command = inputs.no_pictures = inputs.update_summary = "a\xff\x80<";
  inputs.pictures->classes[0].name = "a\xff\x80<";
  const std::string page = MakeReportPage(inputs);
  ParsePage(page);
  EXPECT_THAT(page, HasSubstr("a\\xff\\x80&lt;"));
  EXPECT_EQ(page.find('\xff'), std::string::npos);
}

TEST(ReportPage, LongListsAreCut) {
  json report = json::parse(kPageReport);
  const std::string text(5000, '<');
  for (int i = 0; i < 3000; ++i) {
    report["warnings"].push_back(std::to_string(i) + text);
    report["skipped_images"].push_back({{"name", text}, {"reason", text}});
    report["area_share_after"][text + std::to_string(i)] = 0.1;
    json tile = report["tiles"][1];
    tile["tile"] = 2 + i;
    report["tiles"].push_back(tile);
  }
  ReportPageInputs inputs = SmallPage();
  inputs.report_json = report.dump();
  const std::string page = MakeReportPage(inputs);
  EXPECT_LT(page.size(), size_t{5} << 20);
  EXPECT_THAT(PageText(ParsePage(page)), HasSubstr("more tiles in report.json"));
}

TEST(JobFacts, SumMeasuredTasksOfAKind) {
  const auto facts = ParseJobFacts(kPageJob);
  ASSERT_TRUE(facts.ok());
  const MeasuredTasks& measure = facts->kinds.at("measure");
  EXPECT_EQ(measure.tasks, 2);
  EXPECT_EQ(measure.used_core_s, 4);
  EXPECT_EQ(measure.predicted_core_s, 4);
  EXPECT_EQ(measure.used_peak_bytes, 209715200);
  EXPECT_EQ(measure.predicted_peak_bytes, 314572800) << "of the tasks whose memory was measured";
  EXPECT_EQ(measure.attempts_s, 7);
  EXPECT_EQ(facts->kinds.at("crop").used_core_s, 0) << "reused";
  EXPECT_EQ(facts->tiles.at(1).used_core_s, 1);
  EXPECT_FALSE(ParseJobFacts("{\"tasks\": [{\"kind\":").ok());
}

}  // namespace
}  // namespace tessera
