// From annotations to likelihoods, on a scene without colour information: a grey box on grey ground.
#include "common/classify/classify_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/classify/classified_scene_files.h"
#include "common/classify/classify_report.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

class ClassifySceneTest : public testing::Test {
 protected:
  ClassifySceneTest() : folder_(FreshTestFolder("classify")) {
    tiny_ = WriteTinyScene(folder_ + "/scene");
    scene_ = LoadScene(folder_ + "/scene", nullptr).value();
    mesh_ = LoadSceneMesh(scene_, 0).value();
    annotations_.pixels.assign(scene_.classes.size(), 0);
    for (size_t v = 0; v < 2; ++v) {
      annotations_.images.push_back({v, "painted", tiny_.label_pictures[v]});
      for (const uint8_t label : tiny_.label_pictures[v].data) {
        if (label != 255) ++annotations_.pixels[label];
      }
    }
    options_.boosting.trees = 30;
    options_.samples = 4000;
  }

  std::string Output(const std::string& name, int threads, const ClassifierModel* model = nullptr) {
    const ThreadLimit limit(threads);
    const MeshSurface surface(mesh_, scene_.up_in_local, 0.2);
    ClassifierSelection use;
    if (model == nullptr) {
      trained_ = TrainClassifier(scene_, annotations_, surface, 0.2, options_, {}).value();
      use.trained = &trained_;
      use.annotations = &annotations_;
    }
    use.model = model == nullptr ? &trained_.model : model;
    classified_ = ClassifyScene(scene_, surface, use, folder_ + "/" + name, {}).value();
    return folder_ + "/" + name;
  }

  const std::string folder_;
  TinyScene tiny_;
  SceneDescription scene_;
  TriangleMesh mesh_;
  Annotations annotations_;
  TrainingOptions options_;
  TrainedClassifier trained_;
  ClassifiedScene classified_;
};

TEST_F(ClassifySceneTest, GeometrySeparatesClassesOfEqualColour) {
  const std::string out = Output("out", 0);
  ConfusionMatrix unseen(3);
  for (size_t v = 2; v < scene_.views.size(); ++v) {
    const std::string stem = std::filesystem::path(scene_.views[v].name).stem();
    const FloatImage p =
        ReadLikelihoods(absl::StrCat(out, "/geometry/", stem, ".tif"), 3, scene_.views[v].lens).value();
    for (int y = 0; y < p.height; ++y) {
      for (int x = 0; x < p.width; ++x) {
        int best = 0;
        for (int c = 1; c < 3; ++c) best = p.at(x, y, c) > p.at(x, y, best) ? c : best;
        unseen.Add(tiny_.label_pictures[v].at(x, y), best);
      }
    }
  }
  EXPECT_GT(ScoreLabels(unseen).overall_accuracy, 0.97);
  EXPECT_GT(ScoreLabels(classified_.held_out[1]).overall_accuracy, 0.97);
  EXPECT_EQ(classified_.held_out[1].total(), annotations_.annotated());
}

TEST_F(ClassifySceneTest, DoesNotDependOnThreads) {
  const std::string one = Output("one", 1);
  const std::string model = SerializeModel(trained_.model);
  const std::string four = Output("four", 4);
  EXPECT_EQ(SerializeModel(trained_.model), model);
  const std::vector<std::string> files = ListFiles(one).value();
  EXPECT_EQ(files.size(), 2 * scene_.views.size());
  for (const std::string& file : files) EXPECT_EQ(ReadText(one + "/" + file), ReadText(four + "/" + file)) << file;
}

TEST_F(ClassifySceneTest, AnnotatedPixelsUseTheFoldThatExcludesThem) {
  // Random labels per square of 4 pixels, which only memorising the training pixels could reproduce.
  for (Annotation& a : annotations_.images) {
    for (int y = 0; y < a.labels.height; ++y) {
      for (int x = 0; x < a.labels.width; ++x) {
        a.labels.at(x, y) = static_cast<uint8_t>((x / 4 * 7919 + y / 4 * 104729 + x / 4 * (y / 4)) % 3);
      }
    }
  }
  options_.boosting.trees = 100;
  options_.samples = 100000;
  annotations_.pixels.assign(3, annotations_.images[0].labels.plane_size() * 2 / 3);
  const std::string with_folds = Output("folds", 0);
  const double held_out = ScoreLabels(classified_.held_out[0]).overall_accuracy;
  EXPECT_LT(held_out, 0.40) << "no better than a guess";
}

TEST_F(ClassifySceneTest, LoadedModelGivesTheTrainedLikelihoods) {
  const std::string trained = Output("trained", 0);
  const ClassifierModel model = ParseModel(SerializeModel(trained_.model), "model").value();
  const std::string by_model = Output("by_model", 0, &model);
  for (size_t v = 2; v < scene_.views.size(); ++v) {
    const std::string file =
        absl::StrCat("/geometry/", std::filesystem::path(scene_.views[v].name).stem().string(), ".tif");
    EXPECT_EQ(ReadText(trained + file), ReadText(by_model + file));
  }
}

TEST_F(ClassifySceneTest, ClassifyViewEqualsClassifyScene) {
  const std::string all = Output("all", 0);
  ClassifierSelection use;
  use.model = &trained_.model;
  const MeshSurface surface(mesh_, scene_.up_in_local, 0.2);
  const std::string stem = std::filesystem::path(scene_.views[3].name).stem();
  // Without a surface, the classifier uses appearance.
  for (const bool sees : {true, false}) {
    const auto view = ClassifyView(scene_, 3, sees ? &surface : nullptr, use);
    ASSERT_TRUE(view.ok()) << view.status();
    ASSERT_TRUE(WriteLikelihoodTiff(folder_ + "/one.tif", *view).ok());
    EXPECT_EQ(ReadText(folder_ + "/one.tif"), ReadText(all + (sees ? "/geometry/" : "/appearance/") + stem + ".tif"));
  }
  const DefaultRule rule = DefaultRule::Of({"ground", "facade", "roof"}, "scene").value();
  ClassifierSelection by_rule;
  by_rule.rule = &rule;
  EXPECT_TRUE(ClassifyView(scene_, 3, nullptr, by_rule).ok());
}

TEST_F(ClassifySceneTest, AnnotatedImagesAreNotSuggested) {
  Output("out", 0);
  const std::vector<size_t> next = NextToAnnotate(classified_);
  EXPECT_THAT(next, testing::UnorderedElementsAre(2, 3, 4));
  for (size_t k = 1; k < next.size(); ++k) {
    EXPECT_GE(classified_.views[next[k - 1]].gain, classified_.views[next[k]].gain);
  }
}

TEST_F(ClassifySceneTest, OutputFolderIsALoadableScene) {
  const std::string out = Output("out", 0);
  ASSERT_TRUE(WriteClassifiedScene(scene_, folder_ + "/scene/scene.json", out, "default").ok());
  Warnings warnings;
  const StatusOr<SceneDescription> again = LoadScene(out, &warnings);
  ASSERT_TRUE(again.ok()) << again.status();
  ASSERT_EQ(again->views.size(), scene_.views.size());
  EXPECT_EQ(again->views[0].likelihood_path.substr(0, 9), "geometry/");
  EXPECT_EQ(again->classes.size(), scene_.classes.size());
  EXPECT_THAT(warnings, testing::Contains(testing::HasSubstr("likelihoods come from the default rule")));
  EXPECT_TRUE(CheckClassifiedFolder(out).ok()) << "an earlier one may be replaced";
  EXPECT_TRUE(absl::IsAlreadyExists(CheckClassifiedFolder(folder_ + "/scene")));
  WriteText(out + "/notes.txt", "mine");
  EXPECT_TRUE(absl::IsAlreadyExists(CheckClassifiedFolder(out)));
}

TEST_F(ClassifySceneTest, DefaultRuleClassifiesABoxOnTheGround) {
  const DefaultRule rule = DefaultRule::Of({"ground", "facade", "roof"}, "scene.json").value();
  const MeshSurface surface(mesh_, scene_.up_in_local, 0.2);
  ClassifierSelection use;
  use.rule = &rule;
  const std::string out = folder_ + "/default";
  ASSERT_TRUE(ClassifyScene(scene_, surface, use, out, {}).ok());
  ConfusionMatrix confusion(3);
  const std::string stem = std::filesystem::path(scene_.views[1].name).stem();
  const FloatImage p = ReadLikelihoods(absl::StrCat(out, "/geometry/", stem, ".tif"), 3, scene_.views[1].lens).value();
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      int best = 0;
      for (int c = 1; c < 3; ++c) best = p.at(x, y, c) > p.at(x, y, best) ? c : best;
      confusion.Add(tiny_.label_pictures[1].at(x, y), best);
    }
  }
  EXPECT_GT(ScoreLabels(confusion).overall_accuracy, 0.97);
  EXPECT_FALSE(std::filesystem::exists(out + "/appearance"));
  EXPECT_TRUE(absl::IsInvalidArgument(DefaultRule::Of({"road", "water"}, "scene.json").status()));
}

}  // namespace
}  // namespace tessera
