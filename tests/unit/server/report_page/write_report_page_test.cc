#include "server/report_page/write_report_page.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "server/report_page/job_command.h"
#include "server/report_page/report_pictures.h"
#include "tessera/v1/jobs.pb.h"
#include "tests/support/tiny_scene.h"
#include "tests/unit/server/report_page/page_fixtures.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

// A result in `folder`/out of the tiny scene in `folder`/scene: its roofs raised by half a metre.
struct SmallResult {
  std::string scene, out;
  TriangleMesh start, mesh;
  v1::Job job;

  explicit SmallResult(const std::string& name) {
    const std::string folder = FreshTestFolder(name);
    scene = folder + "/scene";
    out = folder + "/out";
    fs::create_directories(out);
    start = WriteTinyScene(scene).mesh;
    mesh = start;
    for (Eigen::Vector3d& v : mesh.vertices) v.z() += v.z() > 7.9 ? 0.5 : 0;
    WriteMesh();
    nlohmann::json report = nlohmann::json::parse(kPageReport);
    report["input"]["faces"] = start.faces.size();
    report["classes"] = {"ground", "facade", "roof"};
    report["displacement"]["p90_m"] = 0.5;
    WriteText(out + "/report.json", report.dump());
    WriteText(out + "/job.json", kPageJob);
    job.set_name("jobs/7");
    job.set_scene_path(scene);
    job.mutable_end_time()->set_seconds(1795671360);
    for (const char* file : {"mesh.ply", "report.json", "job.json"}) {
      v1::Artifact* artifact = job.add_artifacts();
      artifact->set_name(file);
      artifact->mutable_digest()->set_sha256(std::string(64, file[0]));
    }
  }

  void WriteMesh() const {
    PlyWriteOptions options;
    options.label_colors_rgb = {{10, 20, 30}, {40, 50, 60}, {70, 80, 90}};
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      options.face_confidence.push_back(f % 4 == 0 ? 0.0f : 0.75f);
      options.input_face.push_back(static_cast<int64_t>(f));
    }
    ASSERT_TRUE(WritePly(out + "/mesh.ply", mesh, options).ok());
  }

  PictureInputs Pictures() const {
    PictureInputs inputs;
    inputs.mesh_path = out + "/mesh.ply";
    inputs.start_path = scene + "/mesh.ply";
    inputs.start_faces = static_cast<int64_t>(start.faces.size());
    inputs.typical_displacement_m = 0.5;
    inputs.classes = {{"ground", std::nullopt}, {"facade", std::nullopt}, {"roof", std::nullopt}};
    inputs.scratch_folder = out;
    return inputs;
  }

  std::string Page() const {
    const auto path = WriteReportPage(job, out, "1.2.3", {});
    EXPECT_TRUE(path.ok()) << path.status();
    return path.ok() ? ReadText(*path) : "";
  }
};

TEST(WriteReportPage, ShowsStartAndResult) {
  const SmallResult result("report_page_start");
  const std::string page = result.Page();
  const pugi::xml_document document = ParsePage(page);
  EXPECT_EQ(document.select_nodes("//img").size(), 6u);
  const std::string text = PageText(document);
  EXPECT_THAT(text, HasSubstr("finished 2026-11-2"));
  EXPECT_THAT(text, HasSubstr("tessera run " + result.scene + " --out OUT"));
  EXPECT_THAT(text, HasSubstr(std::string(64, 'm'))) << "the hash of mesh.ply";
  EXPECT_THAT(page, HasSubstr("background:#46505a")) << "the colour of the last class in mesh.ply";
  EXPECT_LT(page.size(), size_t{2} << 20);
  EXPECT_EQ(result.Page(), page) << "the same bytes again";
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(result.out)) files.push_back(entry.path().filename());
  EXPECT_THAT(files, testing::UnorderedElementsAre("mesh.ply", "report.json", "job.json", "report.html"));
}

TEST(WriteReportPage, WithoutTheSceneShowsTheResultAlone) {
  const SmallResult result("report_page_alone");
  fs::remove_all(result.scene);
  const pugi::xml_document document = ParsePage(result.Page());
  EXPECT_EQ(document.select_nodes("//img").size(), 3u) << "shaded, classes, confidence";
  EXPECT_THAT(PageText(document), HasSubstr("the job's scene cannot be read on this machine"));
}

TEST(WriteReportPage, AStartMeshThatChangedIsNotShown) {
  SmallResult result("report_page_changed");
  result.start.faces.pop_back();
  result.start.labels.pop_back();
  ASSERT_TRUE(WritePly(result.scene + "/mesh.ply", result.start).ok());
  const pugi::xml_document document = ParsePage(result.Page());
  EXPECT_EQ(document.select_nodes("//img").size(), 3u);
  EXPECT_THAT(PageText(document), HasSubstr("The scene's mesh has changed since the job"));
}

TEST(WriteReportPage, AMeshThatCannotBeDrawnGivesAPageWithoutPictures) {
  const SmallResult result("report_page_damaged");
  for (const std::string& mesh :
       {std::string(), std::string("ply\nformat ascii 1.0\n"), AsciiPly(result.mesh, "double")}) {
    WriteText(result.out + "/mesh.ply", mesh);
    const pugi::xml_document document = ParsePage(result.Page());
    EXPECT_EQ(document.select_nodes("//img").size(), 0u);
    EXPECT_THAT(PageText(document), HasSubstr("251,210"));
    EXPECT_THAT(PageText(document), HasSubstr("The mesh cannot be drawn"));
  }
  fs::remove(result.out + "/mesh.ply");
  fs::remove(result.out + "/job.json");
  EXPECT_THAT(PageText(ParsePage(result.Page())), HasSubstr("251,210"));
}

TEST(WriteReportPage, ErrorsLeaveNoPage) {
  const SmallResult result("report_page_errors");
  const std::string path = result.out + "/report.html";
  result.Page();
  ASSERT_TRUE(fs::exists(path));
  TaskControl cancelled;
  cancelled.cancelled = [] { return true; };
  EXPECT_TRUE(absl::IsCancelled(WriteReportPage(result.job, result.out, "", cancelled).status()));
  EXPECT_FALSE(fs::exists(path));
  WriteText(result.out + "/report.json", "{");
  EXPECT_FALSE(WriteReportPage(result.job, result.out, "", {}).ok());
  EXPECT_FALSE(fs::exists(path));
}

TEST(WriteReportPage, APlanHasNone) {
  SmallResult result("report_page_plan");
  result.job.clear_artifacts();
  const auto path = WriteReportPage(result.job, result.out, "", {});
  ASSERT_TRUE(path.ok());
  EXPECT_EQ(*path, "");
  EXPECT_FALSE(fs::exists(result.out + "/report.html"));
}

TEST(ReportPictures, DistributionsAreOfTheArea) {
  const SmallResult result("report_page_shares");
  const auto pictures = DrawReportPictures(result.Pictures(), {});
  ASSERT_TRUE(pictures.ok()) << pictures.status();
  double area_m2 = 0, unseen_m2 = 0, raised_m2 = 0, roof_m2 = 0;
  for (size_t f = 0; f < result.mesh.faces.size(); ++f) {
    const double face_m2 = FaceArea(result.mesh, f);
    area_m2 += face_m2;
    if (f % 4 == 0) unseen_m2 += face_m2;
    if (MeshSpans(result.start).Centroid(f).z() > 7.99) roof_m2 += face_m2;
  }
  raised_m2 = roof_m2;
  EXPECT_NEAR(pictures->area_m2, area_m2, 1e-6 * area_m2);
  EXPECT_NEAR(pictures->plan_area_m2, 1600, 1e-6) << "the square of ground, the box instead of what it hides";
  EXPECT_NEAR(pictures->unseen_share, unseen_m2 / area_m2, 1e-9);
  EXPECT_NEAR(pictures->mean_confidence, 0.75, 1e-6);
  ASSERT_TRUE(pictures->confidence_shares && pictures->displacement_shares);
  EXPECT_NEAR(pictures->confidence_shares->shares[30], 1, 1e-9) << "0.75 of 40 intervals";
  EXPECT_EQ(pictures->displacement_range_m, 0.5);
  EXPECT_EQ(pictures->displacement_shares->low, -1);
  EXPECT_NEAR(pictures->displacement_shares->shares[30], raised_m2 / area_m2, 1e-9) << "half a metre outwards";
}

TEST(ReportPictures, ClassesAreSeen) {
  const SmallResult result("report_page_classes");
  const auto pictures = DrawReportPictures(result.Pictures(), {});
  ASSERT_TRUE(pictures.ok()) << pictures.status();
  WriteText(result.out + "/labels.jpg", pictures->labels);
  const auto image = ReadRgb(result.out + "/labels.jpg");
  ASSERT_TRUE(image.ok());
  EXPECT_EQ(image->width, 760);
  EXPECT_EQ(image->height, pictures->height_px);
  // The corner shows the background, the centre the dark mesh.
  EXPECT_GT(image->at(2, 2, 0), 200);
  EXPECT_LT(image->at(image->width / 2, image->height / 2, 0), 90);
}

TEST(ReportPictures, AStrayVertexDoesNotShrinkThePicture) {
  SmallResult result("report_page_stray");
  const auto plain = DrawReportPictures(result.Pictures(), {});
  ASSERT_TRUE(plain.ok());
  result.mesh.vertices.push_back({1e5, 1e5, 1e4});  // no face uses it
  result.WriteMesh();
  const auto stray = DrawReportPictures(result.Pictures(), {});
  ASSERT_TRUE(stray.ok());
  EXPECT_TRUE(stray->shaded == plain->shaded);
}

TEST(ReportPictures, DamagedFacesAreAnError) {
  const SmallResult result("report_page_faces");
  std::string bytes = ReadText(result.out + "/mesh.ply");
  const size_t last_face =
      bytes.size() -
      (bytes.size() - bytes.find("end_header\n") - 11 - 24 * result.mesh.vertices.size()) / result.mesh.faces.size();
  bytes[last_face + 4] = '\x7f';  // the highest byte of an index
  WriteText(result.out + "/mesh.ply", bytes);
  EXPECT_EQ(DrawReportPictures(result.Pictures(), {}).status().code(), absl::StatusCode::kDataLoss);
}

TEST(JobCommand, RepeatsTheSettings) {
  v1::Job job;
  job.set_scene_path("/srv/my city");
  EXPECT_EQ(RunCommandOf(job), "tessera run '/srv/my city' --out OUT");
  v1::JobSettings& settings = *job.mutable_settings();
  settings.set_tiles(4);
  settings.set_method("paper");
  settings.set_skip_images(0.1);
  settings.set_anyway(true);
  settings.mutable_method_settings()->set_thin_plate(0.5);
  settings.mutable_method_settings()->set_flip_edges(false);
  settings.mutable_method_settings()->add_levels(1);
  settings.mutable_method_settings()->add_levels(0);
  const std::string command = RunCommandOf(job);
  for (const char* flag : {" --tiles=4", " --method=paper", " --skip-images=0.1", " --anyway", " --thin-plate=0.5",
                           " --flip-edges=false", " --levels=1,0"}) {
    EXPECT_THAT(command, HasSubstr(flag));
  }
  settings.mutable_update()->set_base("jobs/3");
  settings.mutable_update()->add_withdraw("$(reboot) it's");
  EXPECT_EQ(RunCommandOf(job), "tessera run '/srv/my city' --base=jobs/3 --withdraw='$(reboot) it'\\''s' --out OUT");
  settings.mutable_update()->set_rollback_to("jobs/1");
  EXPECT_EQ(RunCommandOf(job), "");
}

}  // namespace
}  // namespace tessera
