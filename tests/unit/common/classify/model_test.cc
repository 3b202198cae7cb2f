#include "common/classify/model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/arrays/array_file.h"
#include "common/base/random.h"
#include "common/classify/features.h"
#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

ClassifierModel Model() {
  ClassifierModel model;
  model.classes = {"ground", "roof"};
  model.features = FeatureNames();
  model.gsd_m = 0.12;
  Random random(1);
  for (size_t e = 0; e < 2; ++e) {
    BoostedTrees& trees = model.parts[e].trees;
    trees.classes = 2;
    trees.depth = 3;
    trees.feature_count = e == 0 ? AppearanceFeatureCount() : FeatureCount();
    trees.base = {-0.5f, 0.25f};
    for (int q = 0; q < 5 * trees.depth; ++q) {
      trees.features.push_back(static_cast<int32_t>(random.Below(trees.feature_count)));
      trees.thresholds.push_back(static_cast<float>(random.Normal()));
    }
    for (int leaf = 0; leaf < 5 * 8 * 2; ++leaf) trees.leaves.push_back(static_cast<float>(random.Normal()));
    model.parts[e].temperature = 1.25 + static_cast<double>(e);
  }
  return model;
}

TEST(ModelTest, RoundTrip) {
  const std::string path = FreshTestFolder("model") + "/city.model";
  const ClassifierModel model = Model();
  ASSERT_TRUE(WriteFileAtomic(path, SerializeModel(model)).ok());
  const StatusOr<ClassifierModel> read = ReadModel(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(SerializeModel(*read), SerializeModel(model));
  std::vector<float> pixel(FeatureCount(), 0.1f), before(2), after(2);
  for (size_t e = 0; e < 2; ++e) {
    model.parts[e].trees.Score(pixel.data(), 1, 1, before.data());
    read->parts[e].trees.Score(pixel.data(), 1, 1, after.data());
    EXPECT_EQ(before, after);
    EXPECT_EQ(read->parts[e].temperature, model.parts[e].temperature);
  }
}

TEST(ModelTest, DetectsEveryChangedByte) {
  const std::string good = SerializeModel(Model());
  for (size_t at = 0; at < good.size(); at += 7) {
    std::string bytes = good;
    bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
    EXPECT_FALSE(ParseModel(bytes, "FILE").ok()) << "byte " << at;
  }
  for (size_t size = 0; size < good.size(); size += 13) {
    EXPECT_FALSE(ParseModel(good.substr(0, size), "FILE").ok()) << size << " bytes";
  }
}

// Files with valid checksums, so that only the checks of the content can reject them.
TEST(ModelTest, RejectsInvalidContentWithValidChecksums) {
  const auto message = [](auto change) {
    ArrayFile file = ParseArrayFile(SerializeModel(Model()), "FILE").value();
    change(file);
    return std::string(ParseModel(SerializeArrayFile(file), "FILE").status().message());
  };
  const auto replaced = [&](const std::string& from, const std::string& to) {
    return message([&](ArrayFile& file) {
      const size_t at = file.metadata.find(from);
      ASSERT_NE(at, std::string::npos) << from;
      file.metadata.replace(at, from.size(), to);
    });
  };
  EXPECT_THAT(message([](ArrayFile& f) { std::get<std::vector<int32_t>>(f.arrays["geometry.features"])[2] = 100000; }),
              HasSubstr("FILE: geometry: trees: found feature 100000, expected 0 to"));
  EXPECT_THAT(message([](ArrayFile& f) {
                std::get<std::vector<int32_t>>(f.arrays["appearance.features"])[0] = AppearanceFeatureCount();
              }),
              HasSubstr("FILE: appearance: trees: found feature"));
  EXPECT_THAT(message([](ArrayFile& f) { std::get<std::vector<float>>(f.arrays["geometry.leaves"]).pop_back(); }),
              HasSubstr("79 leaf values"));
  EXPECT_NE(message([](ArrayFile& f) { f.arrays.erase("geometry.base"); }), "");
  EXPECT_NE(message([](ArrayFile& f) { f.arrays["geometry.base"] = std::vector<uint8_t>(2); }), "");
  EXPECT_THAT(replaced("tessera classifier", "something else"), HasSubstr("an array file of another kind"));
  EXPECT_THAT(replaced("\"version\":1", "\"version\":7"), HasSubstr("version: found 7, expected 1"));
  EXPECT_THAT(replaced("\"depth\":3", "\"depth\":30"), HasSubstr("depth 30, expected 1 to 12"));
  EXPECT_THAT(replaced("\"depth\":3", "\"depth\":-3"), HasSubstr("depth -3"));
  EXPECT_THAT(replaced("\"depth\":3", "\"depth\":\"x\""), HasSubstr("metadata"));
  EXPECT_THAT(replaced("\"temperature\":1.25", "\"temperature\":0"), HasSubstr("temperature: found 0"));
  EXPECT_THAT(replaced("0.12", "-0.12"), HasSubstr("gsd_m: found -0.12"));
  EXPECT_THAT(replaced("greenness_2", "greenness_9"), HasSubstr("features of another version of Tessera"));
  EXPECT_THAT(replaced("[\"ground\",\"roof\"]", "[\"ground\"]"), HasSubstr("classes: found 1"));
  EXPECT_THAT(message([](ArrayFile& f) { f.metadata = std::string(100, '['); }), HasSubstr("FILE"));
}

}  // namespace
}  // namespace tessera
