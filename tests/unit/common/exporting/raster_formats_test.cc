#include "common/exporting/raster/raster_formats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/exporting/raster/raster_map.h"
#include "common/exporting/raster/raster_pixels.h"
#include "common/geodesy/reference_system.h"
#include "common/storage/xml_file.h"
#include "tests/unit/common/exporting/raster_test_scene.h"

namespace tessera {
namespace {

double RasterPlane(double x, double y) { return 50 + 0.25 * x - 0.125 * y; }

TempFolder RasterFolder() { return *TempFolder::Create(testing::TempDir()); }

// The first sheet beside zero as a plane, in a file of a format.
ReadRasterFile PlaneRaster(const ExportScene& scene, const std::string& crs, const std::string& format) {
  const TempFolder folder = RasterFolder();
  ExportOptions options;
  options.crs = crs;
  const Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane);
  const auto names = WriteRaster(scene, options, {0, 0}, sheet, {}, format, folder.path());
  EXPECT_TRUE(names.ok()) << names.status();
  if (!names.ok() || names->empty() || names->back() != "0_0.tif") {
    ADD_FAILURE() << "no file";
    return {};
  }
  return ReadRaster(folder.path() + "/0_0.tif");
}

TEST(DsmTest, HasTheHeightsOfALocalScene) {
  const ReadRasterFile file = PlaneRaster(LocalRasterScene(), "", "dsm");
  const ReadRasterImage& image = file.images.at(0);
  int with_data = 0;
  for (int row = 0; row < image.height; ++row) {
    for (int column = 0; column < image.width; ++column) {
      const Eigen::Vector2d at = image.CentreOf(column, row);
      const bool inside = at.x() > 0 && at.x() < 128 && at.y() > 0 && at.y() < 128;
      with_data += inside;
      ASSERT_FLOAT_EQ(image.At(column, row), inside ? static_cast<float>(RasterPlane(at.x(), at.y())) : kNoHeight);
    }
  }
  EXPECT_EQ(with_data, 256 * 256);
}

// Pixels of a scene in an east-north-up frame, written in a grid with convergence, scale and other heights: each with
// its height is a point of the plane.
TEST(DsmTest, HasTheHeightsOfAnotherSystem) {
  const ExportScene scene = EnuRasterScene();
  for (const std::string crs : {"EPSG:32633", "EPSG:4326", "EPSG:32633+5773"}) {
    SCOPED_TRACE(crs);
    const ReadRasterFile file = PlaneRaster(scene, crs, "dsm");
    const ReadRasterImage& image = file.images.at(0);
    // A path that shares nothing with the export's map but PROJ.
    ReferenceSystem system = *ReferenceSystem::Parse(crs);
    ASSERT_TRUE(system.LocateGeodetic(*scene.frame.GeodeticFromLocal({64, 64, 50})).ok());
    ReferenceSystem enu = *ReferenceSystem::Of(scene.frame.crs());
    ASSERT_TRUE(enu.LocateGeodetic(*scene.frame.GeodeticFromLocal({64, 64, 50})).ok());
    int with_data = 0;
    for (int row = 0; row < image.height; row += 7) {
      for (int column = 0; column < image.width; column += 7) {
        if (image.At(column, row) == kNoHeight) continue;
        ++with_data;
        const Eigen::Vector2d at = image.CentreOf(column, row);
        Eigen::Vector3d p(at.x(), at.y(), image.At(column, row));
        ASSERT_TRUE(system.ToGeodetic({&p, 1}).ok());
        ASSERT_TRUE(enu.FromGeodetic({&p, 1}).ok());
        p = scene.frame.LocalFromScene(p);
        ASSERT_NEAR(p.z(), RasterPlane(p.x(), p.y()), 1e-3);
        ASSERT_TRUE(p.x() > -0.1 && p.x() < 128.1 && p.y() > -0.1 && p.y() < 128.1) << p.transpose();
      }
    }
    EXPECT_NEAR(with_data, 256 * 256 / 49, 300);
  }
}

TEST(ClassesRasterTest, PutsASpikeWhereItsCoordinatesAre) {
  const ExportScene scene = EnuRasterScene();
  Sheet sheet = GridSheet(0, 0, 128, 128, 4, [](double, double) { return 0; });
  const Eigen::Vector3d peak(100, 90, 30);
  const auto first = static_cast<uint32_t>(sheet.vertices.size());
  for (const Eigen::Vector3d& base :
       {Eigen::Vector3d(-2, -2, 0), Eigen::Vector3d(2, -2, 0), Eigen::Vector3d(0, 2, 0)}) {
    sheet.vertices.push_back(peak + base);
  }
  sheet.faces.push_back({first, first + 1, first + 2});
  sheet.labels.push_back(2);
  const TempFolder folder = RasterFolder();
  ExportOptions options;
  options.crs = "EPSG:32633";
  ASSERT_TRUE(WriteRaster(scene, options, {0, 0}, sheet, {}, "classes", folder.path()).ok());
  const ReadRasterFile file = ReadRaster(folder.path() + "/0_0.tif");
  // By hand: latitude and longitude of the peak, then UTM.
  Eigen::Vector3d p = *scene.frame.GeodeticFromLocal(peak);
  ReferenceSystem utm = *ReferenceSystem::Parse("EPSG:32633");
  ASSERT_TRUE(utm.LocateGeodetic(p).ok());
  ASSERT_TRUE(utm.FromGeodetic({&p, 1}).ok());
  const auto [column, row] = file.images[0].PixelAt(p.x(), p.y());
  EXPECT_EQ(file.images[0].bytes.at(static_cast<size_t>(row) * file.images[0].width + column), 2);
}

TEST(DsmTest, ReadsFacesOfNeighboursAndLeavesTheirPixels) {
  const ExportScene scene = LocalRasterScene();
  const TempFolder folder = RasterFolder();
  const Sheet flat = GridSheet(0, 0, 128, 128, 4, [](double, double) { return 1; });
  Sheet east = GridSheet(120, 40, 136, 60, 4, [](double, double) { return 9; });  // overhangs the sheet's border
  ASSERT_TRUE(WriteRaster(scene, {}, {0, 0}, flat, {east}, "dsm", folder.path()).ok());
  const ReadRasterImage image = ReadRaster(folder.path() + "/0_0.tif").images.at(0);
  const auto height = [&](double x, double y) {
    const auto [column, row] = image.PixelAt(x, y);
    return image.At(column, row);
  };
  EXPECT_EQ(height(119.25, 50.25), 1);
  EXPECT_EQ(height(120.75, 50.25), 9);
  EXPECT_EQ(height(127.75, 50.25), 9);
  EXPECT_EQ(height(128.25, 50.25), kNoHeight);  // a pixel of the neighbour
}

TEST(DsmTest, HasTheUpOfALocalSceneWithAnotherUp) {
  ExportScene scene = LocalRasterScene();
  scene.up = Eigen::Vector3d::UnitY();
  scene.ground = MakeGroundPlane(scene.up, 8);
  Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane);
  for (Eigen::Vector3d& p : sheet.vertices)
    p = scene.ground.axis_x * p.x() + scene.ground.axis_y * p.y() + scene.up * p.z();
  const TempFolder folder = RasterFolder();
  ASSERT_TRUE(WriteRaster(scene, {}, {0, 0}, sheet, {}, "dsm", folder.path()).ok());
  const ReadRasterImage image = ReadRaster(folder.path() + "/0_0.tif").images.at(0);
  const auto [column, row] = image.PixelAt(20.25, 30.25);
  EXPECT_FLOAT_EQ(image.At(column, row), static_cast<float>(RasterPlane(20.25, 30.25)));
}

// Scenes have metres, also where their system has feet; files have the system's units.
TEST(DsmTest, HasTheUnitsOfItsSystem) {
  Crs crs;
  crs.kind = Crs::Kind::kProjected;
  crs.epsg = 2263;  // New York, US survey feet
  const ExportScene scene = RasterScene(crs, {300000, 60000, 0});
  ReadRasterFile file = PlaneRaster(scene, "", "dsm");
  EXPECT_EQ(file.keys[ProjectedCSTypeGeoKey], 2263);
  EXPECT_EQ(file.keys[ProjLinearUnitsGeoKey], 9003);
  const ReadRasterImage& image = file.images.at(0);
  EXPECT_THAT(image.texts.at(42112), testing::HasSubstr(">US survey foot<"));
  constexpr double kFoot_m = 1200.0 / 3937;
  EXPECT_DOUBLE_EQ(image.numbers.at(33550)[0], 2);  // 1.64 feet are 0.5 m
  const Eigen::Vector3d p = scene.frame.SceneFromLocal({20, 30, 0}) / kFoot_m;
  const auto [column, row] = image.PixelAt(p.x(), p.y());
  const Eigen::Vector2d centre = image.CentreOf(column, row) * kFoot_m;
  const Eigen::Vector3d local = scene.frame.LocalFromScene({centre.x(), centre.y(), 0});
  EXPECT_NEAR(image.At(column, row) * kFoot_m, RasterPlane(local.x(), local.y()), 1e-4);
}

TEST(DsmTest, HasTheTagsOfItsLayout) {
  const ReadRasterFile file = PlaneRaster(LocalRasterScene(), "", "dsm");
  ASSERT_EQ(file.images.size(), 5u);  // overviews of factors 2, 4, 8, 16
  for (size_t k = 0; k < file.images.size(); ++k) {
    const ReadRasterImage& image = file.images[k];
    EXPECT_EQ(image.width, file.images[0].width >> k);  // widths are multiples of 16
    EXPECT_EQ(image.numbers.at(TIFFTAG_SUBFILETYPE)[0], k == 0 ? 0 : FILETYPE_REDUCEDIMAGE);
    EXPECT_EQ(image.numbers.at(TIFFTAG_COMPRESSION)[0], COMPRESSION_ADOBE_DEFLATE);
    EXPECT_EQ(image.numbers.at(TIFFTAG_PREDICTOR)[0], PREDICTOR_FLOATINGPOINT);
    EXPECT_EQ(image.numbers.at(TIFFTAG_TILEWIDTH)[0], 256);
    EXPECT_EQ(image.texts.at(42113), "-9999");
    EXPECT_EQ(image.texts.count(TIFFTAG_DATETIME), 0u);
  }
  const ReadRasterImage &image = file.images[0], &half = file.images[1];
  EXPECT_THAT(image.numbers.at(33550), testing::ElementsAre(0.5, 0.5, 0));
  EXPECT_THAT(image.numbers.at(33922), testing::ElementsAre(0, 0, 0, -8, 136, 0));
  EXPECT_THAT(image.texts.at(42112), testing::HasSubstr("<Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">m<"));
  // The mean of four pixels.
  EXPECT_NEAR(half.At(50, 60), (image.At(100, 120) + image.At(101, 120) + image.At(100, 121) + image.At(101, 121)) / 4,
              1e-4);
  EXPECT_EQ(half.At(0, 0), kNoHeight);
}

TEST(DsmTest, NamesItsSystemByCodes) {
  ReadRasterFile file = PlaneRaster(EnuRasterScene(), "EPSG:32633+5773", "dsm");
  EXPECT_EQ(file.keys[GTModelTypeGeoKey], ModelTypeProjected);
  EXPECT_EQ(file.keys[GTRasterTypeGeoKey], RasterPixelIsArea);
  EXPECT_EQ(file.keys[ProjectedCSTypeGeoKey], 32633);
  EXPECT_EQ(file.keys[ProjLinearUnitsGeoKey], 9001);
  EXPECT_EQ(file.keys[VerticalCSTypeGeoKey], 5773);
  EXPECT_EQ(file.keys[VerticalUnitsGeoKey], 9001);
  EXPECT_EQ(file.minor_revision, 1);  // without it, GDAL ignores the vertical system
  file = PlaneRaster(EnuRasterScene(), "EPSG:32633+5773", "classes");
  EXPECT_EQ(file.keys[ProjectedCSTypeGeoKey], 32633);
  EXPECT_EQ(file.keys.count(VerticalCSTypeGeoKey), 0u);  // its pixels are no heights
  file = PlaneRaster(UtmRasterScene(), "", "dsm");       // the scene's own system
  EXPECT_EQ(file.keys[ProjectedCSTypeGeoKey], 32633);
  file = PlaneRaster(EnuRasterScene(), "EPSG:4326", "dsm");
  EXPECT_EQ(file.keys[GTModelTypeGeoKey], ModelTypeGeographic);
  EXPECT_EQ(file.keys[GeographicTypeGeoKey], 4326);
  EXPECT_EQ(file.minor_revision, 0);
  file = PlaneRaster(EnuRasterScene(), "EPSG:4979", "dsm");  // three dimensions
  EXPECT_EQ(file.keys[GeographicTypeGeoKey], 4326);
}

TEST(DsmTest, NamesSystemsWithoutCodesByText) {
  ReadRasterFile file = PlaneRaster(EnuRasterScene(), "", "dsm");
  EXPECT_EQ(file.keys[GTModelTypeGeoKey], 32767);
  EXPECT_THAT(file.key_texts[GTCitationGeoKey], testing::StartsWith("ENU:50,12,0"));
  file = PlaneRaster(LocalRasterScene(), "", "dsm");
  EXPECT_EQ(file.key_texts[GTCitationGeoKey], "local coordinates of the scene");
  EXPECT_EQ(file.keys.count(ProjectedCSTypeGeoKey), 0u);

  const TempFolder folder = RasterFolder();
  ExportOptions options;
  options.crs = "+proj=tmerc +lat_0=49.5 +lon_0=12.25 +k=1 +x_0=5000 +y_0=0 +datum=WGS84 +units=m";
  const Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane);
  const auto names = WriteRaster(EnuRasterScene(), options, {0, 0}, sheet, {}, "dsm", folder.path());
  ASSERT_TRUE(names.ok()) << names.status();
  EXPECT_THAT(*names, testing::ElementsAre("0_0.prj", "0_0.tif"));
  file = ReadRaster(folder.path() + "/0_0.tif");
  EXPECT_THAT(file.key_texts[PCSCitationGeoKey], testing::StartsWith("ESRI PE String = PROJCS["));
  EXPECT_THAT(*ReadFile(folder.path() + "/0_0.prj"), testing::HasSubstr("\"Central_Meridian\",12.25"));
}

TEST(ClassesRasterTest, HasIndicesColoursAndNames) {
  const ExportScene scene = LocalRasterScene();
  const TempFolder folder = RasterFolder();
  const auto label = [](double x, double) { return x < 40 ? 0 : x < 80 ? 1 : -1; };
  const Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane, label);
  ASSERT_TRUE(WriteRaster(scene, {}, {0, 0}, sheet, {}, "classes", folder.path()).ok());
  const ReadRasterFile file = ReadRaster(folder.path() + "/0_0.tif");
  const ReadRasterImage& image = file.images.at(0);
  const auto value = [&](double x, double y) -> int {
    const auto [column, row] = image.PixelAt(x, y);
    return image.bytes[static_cast<size_t>(row) * image.width + column];
  };
  EXPECT_EQ(value(10.25, 10.25), 0);
  EXPECT_EQ(value(50.25, 10.25), 1);
  EXPECT_EQ(value(100.25, 10.25), kNoClass);
  EXPECT_EQ(value(-3.25, 10.25), kNoClass);
  EXPECT_EQ(image.texts.at(42113), "255");
  EXPECT_EQ(image.numbers.at(TIFFTAG_PHOTOMETRIC)[0], PHOTOMETRIC_PALETTE);
  EXPECT_EQ(image.palette[1], 200 * 257);
  EXPECT_EQ(image.palette[256 + 1], 100 * 257);
  EXPECT_EQ(image.palette[512], 30 * 257);
  // The hostile name stays text.
  std::string metadata = image.texts.at(42112);
  EXPECT_THAT(metadata, testing::Not(testing::HasSubstr("<b")));
  const StatusOr<XmlFile> xml = XmlFile::Parse(metadata, "metadata");
  ASSERT_TRUE(xml.ok()) << xml.status();
  std::vector<std::string> names;
  for (XmlNode item = xml->Root().Child("Item"); item; item = item.Next("Item")) {
    if (item.Attribute("name")->substr(0, 6) == "CLASS_") names.emplace_back(item.Text());
  }
  EXPECT_THAT(names, testing::ElementsAre("ground", "<b a=\"1\">roof & 'wall'</b>\\n]]>\\x01", "tree"));
}

TEST(RasterPixelsTest, OverviewsOfClassesHaveTheMostFrequent) {
  RasterPixels pixels = EmptyRaster(RasterContent::kClasses, 4, 3);
  pixels.bytes = {2, 1,   255, 255,  //
                  1, 2,   255, 7,    //
                  3, 255, 255, 255};
  const RasterPixels half = HalfRaster(pixels);
  EXPECT_EQ(half.width, 2);
  EXPECT_EQ(half.height, 2);
  EXPECT_THAT(half.bytes, testing::ElementsAre(1, 7, 3, 255));
}

TEST(RasterPixelsTest, OverviewsOfColoursAreMeansOfKnownPixels) {
  RasterPixels pixels = EmptyRaster(RasterContent::kColors, 2, 2);
  pixels.bytes = {10, 20, 30, 255, 99, 99, 99, 0, 11, 40, 30, 255, 99, 99, 99, 0};
  EXPECT_THAT(HalfRaster(pixels).bytes, testing::ElementsAre(11, 30, 30, 255));
  EXPECT_TRUE(pixels.HasData());
  EXPECT_FALSE(EmptyRaster(RasterContent::kColors, 2, 2).HasData());
}

// Paints the surface by its local coordinates; the eastern half is not seen.
Status PaintOrtho(const SheetInput&, const OrthoPoints& at, std::vector<Rgb>* colors, std::vector<uint8_t>* seen,
                  const TaskControl&) {
  for (size_t k = 0; k < at.points.size(); ++k) {
    const Eigen::Vector3d& p = at.points[k];
    EXPECT_NEAR(p.z(), RasterPlane(p.x(), p.y()), 1e-9);
    EXPECT_GT(at.normals[k].z(), 0.9f);
    EXPECT_NEAR(at.normals[k].norm(), 1, 1e-6);
    colors->push_back({static_cast<uint8_t>(p.x()), static_cast<uint8_t>(p.y()), 77});
    seen->push_back(p.x() < 64 ? 2 : 0);
  }
  return absl::OkStatus();
}

TEST(OrthoTest, HasTheColoursOfTheSurface) {
  const ExportScene scene = LocalRasterScene();
  const TempFolder folder = RasterFolder();
  Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane);
  std::swap(sheet.faces[40][0], sheet.faces[40][1]);  // a face that looks down
  const ExportOptions options;
  SheetInput input = RasterInput(scene, options, {0, 0});
  input.sheet = sheet;
  input.set_aside = true;
  const auto names = WriteOrthoSheetWith(PaintOrtho, input, folder.path(), {});
  ASSERT_TRUE(names.ok()) << names.status();
  const ReadRasterFile file = ReadRaster(folder.path() + "/0_0.tif");
  const ReadRasterImage& image = file.images.at(0);
  ASSERT_EQ(image.samples, 4);
  EXPECT_THAT(image.numbers.at(TIFFTAG_EXTRASAMPLES), testing::ElementsAre(EXTRASAMPLE_UNASSALPHA));
  EXPECT_EQ(image.numbers.at(TIFFTAG_PREDICTOR)[0], PREDICTOR_HORIZONTAL);
  EXPECT_THAT(image.texts.at(42112), testing::HasSubstr("<Item name=\"QUARANTINED\">YES</Item>"));
  for (int row = 0; row < image.height; ++row) {
    for (int column = 0; column < image.width; ++column) {
      const Eigen::Vector2d at = image.CentreOf(column, row);
      const uint8_t* const pixel = &image.bytes[4 * (static_cast<size_t>(row) * image.width + column)];
      const bool seen = at.x() > 0 && at.x() < 64 && at.y() > 0 && at.y() < 128;
      ASSERT_EQ(pixel[3], seen ? 255 : 0);
      ASSERT_EQ(pixel[0], seen ? static_cast<uint8_t>(at.x()) : 0);
      ASSERT_EQ(pixel[1], seen ? static_cast<uint8_t>(at.y()) : 0);
    }
  }
}

TEST(RasterFormatsTest, WriteTheSameBytesTwice) {
  const ExportScene scene = EnuRasterScene();
  ExportOptions options;
  options.crs = "EPSG:25833";
  const Sheet sheet = GridSheet(0, 0, 128, 128, 4, RasterPlane);
  for (const std::string format : {"dsm", "classes"}) {
    const TempFolder first = RasterFolder(), second = RasterFolder();
    ASSERT_TRUE(WriteRaster(scene, options, {0, 0}, sheet, {}, format, first.path()).ok());
    ASSERT_TRUE(WriteRaster(scene, options, {0, 0}, sheet, {}, format, second.path()).ok());
    for (const char* name : {"/0_0.tif", "/part.arrays"}) {
      EXPECT_EQ(*ReadFile(first.path() + name), *ReadFile(second.path() + name)) << format << name;
    }
  }
}

TEST(RasterFormatsTest, MosaicOfSheetsHasAllAtTheirPlaces) {
  const ExportScene scene = EnuRasterScene();
  ExportOptions options;
  options.crs = "EPSG:32633";
  const TempFolder parts = RasterFolder(), out = RasterFolder();
  JoinInput join = RasterJoin(scene, options);
  std::vector<ReadRasterImage> images;
  for (const SheetId& id : {SheetId{-1, 0}, SheetId{0, 0}, SheetId{1, 0}}) {
    const double x0 = 128 * id.x;
    Sheet sheet;
    if (id.x != 1) sheet = GridSheet(x0, 0, x0 + 128, 128, 4, RasterPlane);  // the last has no faces in its square
    const std::string folder = parts.path() + "/" + SheetName(id);
    ASSERT_TRUE(EnsureFolder(folder).ok());
    const auto names = WriteRaster(scene, options, id, sheet, {}, "classes", folder);
    ASSERT_TRUE(names.ok()) << names.status();
    EXPECT_EQ(names->size(), id.x == 1 ? 0u : 1u);
    join.sheets.push_back({id, "", folder + "/" + kPartFile, false});
    if (id.x != 1) images.push_back(ReadRaster(folder + "/" + SheetName(id) + ".tif").images.at(0));
  }
  const auto names = JoinClasses(join, out.path(), {});
  ASSERT_TRUE(names.ok()) << names.status();
  ASSERT_THAT(*names, testing::ElementsAre("classes.vrt"));
  const StatusOr<XmlFile> vrt = XmlFile::Parse(*ReadFile(out.path() + "/classes.vrt"), "classes.vrt");
  ASSERT_TRUE(vrt.ok()) << vrt.status();
  const XmlNode root = vrt->Root(), band = root.Child("VRTRasterBand");
  EXPECT_THAT(std::string(root.Child("SRS").Text()), testing::HasSubstr("AUTHORITY[\"EPSG\",\"32633\"]"));
  EXPECT_EQ(band.Child("NoDataValue").Text(), "255");
  EXPECT_EQ(band.Child("CategoryNames").Child("Category").Next().Text(), "<b a=\"1\">roof & 'wall'</b>\\n]]>\\x01");
  std::string transform(root.Child("GeoTransform").Text());
  double west = 0, north = 0, size = 0;
  ASSERT_EQ(std::sscanf(transform.c_str(), "%lf, %lf, 0, %lf", &west, &size, &north), 3);
  EXPECT_EQ(size, 0.5);
  size_t k = 0;
  for (XmlNode source = band.Child("ComplexSource"); source; source = source.Next("ComplexSource"), ++k) {
    ASSERT_LT(k, images.size());
    EXPECT_EQ(source.Child("SourceFilename").Text(), k == 0 ? "-1_0.tif" : "0_0.tif");
    EXPECT_EQ(source.Child("SourceFilename").Attribute("relativeToVRT"), "1");
    EXPECT_EQ(source.Child("NODATA").Text(), "255");
    Faults faults;
    const XmlNode place = source.Child("DstRect");
    const Eigen::Vector2d corner = images[k].CentreOf(0, 0) + Eigen::Vector2d(-0.25, 0.25);
    EXPECT_EQ(west + size * *place.NumberAttribute("xOff", &faults), corner.x());
    EXPECT_EQ(north - size * *place.NumberAttribute("yOff", &faults), corner.y());
    EXPECT_EQ(*place.IntegerAttribute("xSize", &faults), images[k].width);
    EXPECT_EQ(*place.IntegerAttribute("ySize", &faults), images[k].height);
    EXPECT_TRUE(faults.empty());
  }
  EXPECT_EQ(k, images.size());
}

TEST(RasterFormatsTest, MosaicOfNothingIsNoFile) {
  const ExportScene scene = LocalRasterScene();
  const TempFolder folder = RasterFolder();
  const ExportOptions options;
  const JoinInput join = RasterJoin(scene, options);
  const auto names = JoinDsm(join, folder.path(), {});
  ASSERT_TRUE(names.ok());
  EXPECT_TRUE(names->empty());
  EXPECT_FALSE(FileExists(folder.path() + "/dsm.vrt"));
}

}  // namespace
}  // namespace tessera
