// The proof of a block on its tie points: what each wrong convention does to it, and what its user is told.
#include "common/importing/proof/proof.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "common/importing/proof/residuals.h"
#include "tests/support/blocks/truth_block.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using Kind = LensModel::Kind;

constexpr Kind kLensKinds[] = {Kind::kPinhole, Kind::kSimpleRadial, Kind::kRadial,
                               Kind::kOpenCv,  Kind::kFullOpenCv,   Kind::kBrown};

ImportedBlock ProofTruth(Kind kind, double noise_px, unsigned seed = 1) {
  TruthOptions options;
  options.lens = kind;
  options.centre = {2000, -700, 90};
  options.points = 400;
  options.seed = seed;
  ImportedBlock block = MakeTruthBlock(options);
  block.files = {"/data/block.xml"};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  for (BlockTiePoint& point : block.points) {
    for (BlockObservation& observation : point.observations) {
      observation.position_px += noise_px * Eigen::Vector2d(noise(random), noise(random));
    }
  }
  return block;
}

struct Judged {
  Proof proof;
  std::string refusal;
  Warnings warnings;
  // Everything that the user is told.
  std::string Told() const {
    std::string text = refusal;
    for (const std::string& warning : warnings) text += warning;
    return text;
  }
};

Judged Judge(ImportedBlock* block, const ProofOptions& options = {}) {
  Judged judged;
  judged.proof = MeasureProof(block, options);
  judged.refusal = std::string(JudgeProof(*block, judged.proof, options, &judged.warnings).message());
  return judged;
}

TEST(ProofTest, TrueBlocksPassWithoutWarning) {
  for (const Kind kind : kLensKinds) {
    for (const double noise_px : {0.0, 0.3}) {
      for (const unsigned seed : {1u, 2u, 3u}) {
        ImportedBlock block = ProofTruth(kind, noise_px, seed);
        Warnings warnings;
        const StatusOr<Proof> proof = ProveByTiePoints(&block, {}, &warnings);
        ASSERT_TRUE(proof.ok()) << proof.status();
        EXPECT_THAT(warnings, IsEmpty());
        EXPECT_TRUE(proof->is_proven);
        EXPECT_THAT(proof->bad_images, IsEmpty());
        // Of Rayleigh's distribution.
        EXPECT_NEAR(proof->tie_points.median_px, 1.1774 * noise_px, 0.06 * noise_px + 1e-6);
        EXPECT_NEAR(proof->tie_points.p95_px, 2.4477 * noise_px, 0.06 * noise_px + 1e-6);
        EXPECT_THAT(block.conventions, IsEmpty());
        // What changes nothing is not listed.
        if (kind != Kind::kPinhole) continue;
        EXPECT_THAT(proof->alternatives, Not(Contains(Field(&ProofAlternative::name, "P1 and P2 swapped"))));
      }
    }
  }
}

TEST(ProofTest, RowsHoldTheObservationsOfEachCameraAndImage) {
  ImportedBlock block = ProofTruth(Kind::kBrown, 0.3);
  const Proof proof = MeasureProof(&block, {});
  ASSERT_EQ(proof.cameras.size(), 2u);
  EXPECT_EQ(proof.cameras[1].name, "camera 1");
  EXPECT_EQ(proof.cameras[0].residuals.observations + proof.cameras[1].residuals.observations,
            proof.tie_points.observations);
  ASSERT_EQ(proof.images.size(), block.images.size());
  int64_t of_images = 0;
  for (const ProofRow& row : proof.images) of_images += row.residuals.observations;
  EXPECT_EQ(of_images, proof.tie_points.observations);
  EXPECT_EQ(proof.images[2].name, block.images[2].path);
}

// A wrong convention, put into a true block, and the text of the alternative that undoes it.
struct WrongConvention {
  const char* name;
  Kind kind;
  void (*put)(ImportedBlock*);
  const char* undone_by;
  bool is_refused;  // at 1.5 px
};

void ForEachTruthImage(ImportedBlock* block, const std::function<void(BlockImage&)>& change) {
  for (BlockImage& image : block->images) change(image);
}
void ForEachTruthLens(ImportedBlock* block, const std::function<void(LensModel&)>& change) {
  for (BlockCamera& camera : block->cameras) change(camera.lens);
}
void NegateCameraAxes(BlockImage& image, double x, double y, double z) {
  image.rotation_cam_from_block = Eigen::DiagonalMatrix<double, 3>(x, y, z) * image.rotation_cam_from_block;
}

const WrongConvention kWrongConventions[] = {
    {"half a pixel more", Kind::kOpenCv,
     [](ImportedBlock* b) { ForEachTruthLens(b, [](LensModel& l) { l.pinhole.cx += 0.5, l.pinhole.cy += 0.5; }); },
     "a principal point half a pixel left and up", false},
    {"half a pixel less", Kind::kPinhole,
     [](ImportedBlock* b) { ForEachTruthLens(b, [](LensModel& l) { l.pinhole.cx -= 0.5, l.pinhole.cy -= 0.5; }); },
     "a principal point half a pixel right and down", false},
    {"P1, P2 swapped", Kind::kBrown,
     [](ImportedBlock* b) {
       ForEachTruthLens(b, [](LensModel& l) { std::swap(l.coefficients[2], l.coefficients[3]); });
     },
     "P1 and P2 swapped", false},
    {"R transposed", Kind::kRadial,
     [](ImportedBlock* b) {
       ForEachTruthImage(b, [](BlockImage& i) { i.rotation_cam_from_block.transposeInPlace(); });
     },
     "transposed rotations", true},
    {"y and z of cameras negated", Kind::kOpenCv,
     [](ImportedBlock* b) { ForEachTruthImage(b, [](BlockImage& i) { NegateCameraAxes(i, 1, -1, -1); }); },
     "camera axes (x, -y, -z) of OpenGL", true},
    {"x and y of cameras negated", Kind::kOpenCv,
     [](ImportedBlock* b) { ForEachTruthImage(b, [](BlockImage& i) { NegateCameraAxes(i, -1, -1, 1); }); },
     "camera axes (-x, -y, z)", true},
    {"y of cameras negated", Kind::kOpenCv,
     [](ImportedBlock* b) { ForEachTruthImage(b, [](BlockImage& i) { NegateCameraAxes(i, 1, -1, 1); }); },
     "camera axes (x, -y, z)", true},
    {"x and y of cameras exchanged", Kind::kOpenCv,
     [](ImportedBlock* b) {
       ForEachTruthImage(
           b, [](BlockImage& i) { i.rotation_cam_from_block.row(0).swap(i.rotation_cam_from_block.row(1)); });
     },
     "camera axes (y, x, z)", true},
    {"z of points negated", Kind::kPinhole,
     [](ImportedBlock* b) {
       for (BlockTiePoint& point : b->points) point.position.z() *= -1;
     },
     "points in the axes (x, y, -z)", true},
    {"y and z of centres exchanged", Kind::kPinhole,
     [](ImportedBlock* b) { ForEachTruthImage(b, [](BlockImage& i) { std::swap(i.centre.y(), i.centre.z()); }); },
     "centres in the axes (x, z, y)", true},
    {"rotations of east-north-up read as north-east-down", Kind::kPinhole,
     [](ImportedBlock* b) {
       Eigen::Matrix3d swap;
       swap << 0, 1, 0, 1, 0, 0, 0, 0, -1;
       ForEachTruthImage(b, [&](BlockImage& i) { i.rotation_cam_from_block = i.rotation_cam_from_block * swap; });
     },
     "rotations of the axes (y, x, -z)", true},
    {"translations read as centres", Kind::kOpenCv,
     [](ImportedBlock* b) {
       ForEachTruthImage(b, [](BlockImage& i) { i.centre = -i.rotation_cam_from_block * i.centre; });
     },
     "centres that are translations", true},
    {"centres read as translations", Kind::kOpenCv,
     [](ImportedBlock* b) {
       ForEachTruthImage(b, [](BlockImage& i) { i.centre = -i.rotation_cam_from_block.transpose() * i.centre; });
     },
     "translations that are centres", true},
    {"camera-to-world matrices read as world-to-camera", Kind::kOpenCv,
     [](ImportedBlock* b) {
       ForEachTruthImage(b, [](BlockImage& i) {
         i.rotation_cam_from_block.transposeInPlace();
         i.centre = -i.rotation_cam_from_block.transpose() * i.centre;
       });
     },
     "transposed rotations and centres that are translations", true},
    {"R transposed, half a pixel and OpenGL", Kind::kOpenCv,
     [](ImportedBlock* b) {
       ForEachTruthImage(b, [](BlockImage& i) {
         NegateCameraAxes(i, 1, -1, -1);
         i.rotation_cam_from_block.transposeInPlace();
       });
       ForEachTruthLens(b, [](LensModel& l) { l.pinhole.cx += 0.5, l.pinhole.cy += 0.5; });
     },
     "transposed rotations and camera axes (x, -y, -z) of OpenGL, a principal point half a pixel left and up", true},
    {"principal point read as from the corner", Kind::kRadial,
     [](ImportedBlock* b) {
       ForEachTruthLens(b, [](LensModel& l) {
         l.pinhole.cx -= l.pinhole.width / 2.0;
         l.pinhole.cy -= l.pinhole.height / 2.0;
       });
     },
     "a principal point from the middle", true},
    {"radial coefficients negated", Kind::kRadial,
     [](ImportedBlock* b) {
       ForEachTruthLens(b, [](LensModel& l) { l.coefficients[0] *= -1, l.coefficients[1] *= -1; });
     },
     "radial coefficients negated", true},
    {"focal lengths by the height", Kind::kPinhole,
     [](ImportedBlock* b) {
       ForEachTruthLens(b, [](LensModel& l) {
         const double factor = static_cast<double>(std::max(l.pinhole.width, l.pinhole.height)) / l.pinhole.height;
         l.pinhole.fx *= factor, l.pinhole.fy *= factor;
       });
     },
     "focal lengths by the height instead of the longer side", true},
    {"v from the bottom", Kind::kPinhole,
     [](ImportedBlock* b) {
       for (BlockTiePoint& point : b->points) {
         for (BlockObservation& o : point.observations) {
           o.position_px.y() = b->cameras[b->images[o.image].camera].lens.pinhole.height - o.position_px.y();
         }
       }
     },
     "image points counted from the bottom", true},
};

TEST(ProofTest, EachWrongConventionIsNamed) {
  for (const WrongConvention& wrong : kWrongConventions) {
    for (const double noise_px : {0.0, 0.3}) {
      SCOPED_TRACE(testing::Message() << wrong.name << ", noise " << noise_px);
      ImportedBlock block = ProofTruth(wrong.kind, noise_px);
      wrong.put(&block);
      const Judged judged = Judge(&block);
      if (wrong.is_refused) {
        EXPECT_THAT(judged.refusal, HasSubstr("at most 1.5 px (--max-error-px)"));
        EXPECT_FALSE(judged.proof.is_proven);
      }
      ASSERT_FALSE(judged.proof.alternatives.empty());
      EXPECT_EQ(judged.proof.alternatives[0].name, wrong.undone_by);
      EXPECT_TRUE(judged.proof.alternatives[0].is_better);
      EXPECT_NEAR(judged.proof.alternatives[0].residuals.median_px, 1.1774 * noise_px, 0.03 * noise_px + 1e-3);
      EXPECT_THAT(judged.Told(), HasSubstr(wrong.undone_by));
    }
  }
}

// The model of the other direction, whose coefficients were taken for those of this one.
TEST(ProofTest, InverseDistortionIsNamed) {
  ImportedBlock block = ProofTruth(Kind::kSimpleRadial, 0.1);
  for (BlockTiePoint& point : block.points) {
    for (BlockObservation& o : point.observations) {
      const LensModel& lens = block.cameras[block.images[o.image].camera].lens;
      o.position_px = lens.Undistort(lens.Undistort(o.position_px));
    }
  }
  const Judged judged = Judge(&block);
  EXPECT_THAT(judged.refusal, HasSubstr("px with distortion the other way"));
  EXPECT_EQ(judged.proof.alternatives[0].name, "distortion the other way");
}

TEST(ProofTest, RefusalHasTheFileAndTheFigures) {
  ImportedBlock block = ProofTruth(Kind::kPinhole, 0.3);
  ForEachTruthImage(&block, [](BlockImage& i) { i.rotation_cam_from_block.transposeInPlace(); });
  Warnings warnings;
  const StatusOr<Proof> proof = ProveByTiePoints(&block, {}, &warnings);
  EXPECT_EQ(proof.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(proof.status().message()),
              AllOf(HasSubstr("/data/block.xml: tie points: found a median residual of "),
                    HasSubstr(" observations), expected at most 1.5 px (--max-error-px)"), HasSubstr("\n  0.35"),
                    HasSubstr(" px with transposed rotations\n")));
  // Accepted with another bound, with a warning.
  ProofOptions options;
  options.max_error_px = 1e6;
  ForEachTruthImage(&block, [](BlockImage& i) { i.rotation_cam_from_block.transposeInPlace(); });
  ForEachTruthLens(&block, [](LensModel& l) { l.pinhole.cx += 3; });
  EXPECT_FALSE(ProveByTiePoints(&block, {}, &warnings).ok());
  EXPECT_TRUE(ProveByTiePoints(&block, options, &warnings).ok());
}

TEST(ProofTest, NamesImagesWithBadResiduals) {
  ImportedBlock block = ProofTruth(Kind::kOpenCv, 0.3);
  block.images[4].centre += Eigen::Vector3d(0.15, 0, 0);  // some 4 px
  const Judged judged = Judge(&block);
  EXPECT_EQ(judged.refusal, "");
  ASSERT_THAT(judged.proof.bad_images, ElementsAre(4));
  EXPECT_THAT(judged.warnings, ElementsAre(AllOf(HasSubstr("1 of 9 images"), HasSubstr(block.images[4].path))));
}

TEST(ProofTest, ControlPointsAreTold) {
  ImportedBlock block = ProofTruth(Kind::kOpenCv, 0.3);
  block.control_points.assign(block.points.begin(), block.points.begin() + 20);
  EXPECT_THAT(Judge(&block).warnings, IsEmpty());
  for (BlockTiePoint& point : block.control_points) point.position.z() += 2;
  const Judged judged = Judge(&block);
  EXPECT_GT(judged.proof.control_points.median_px, 10);
  EXPECT_THAT(judged.warnings, ElementsAre(HasSubstr("control points do not fit")));
  // Alone, they are the proof.
  block.points.clear();
  EXPECT_THAT(Judge(&block).refusal, HasSubstr("a median residual"));
}

class ReadingsTest : public testing::Test {
 protected:
  ReadingsTest() {
    block_.readings.push_back({"P1 and P2 as Agisoft writes them", [](ImportedBlock* b) {
                                 ForEachTruthLens(
                                     b, [](LensModel& l) { std::swap(l.coefficients[2], l.coefficients[3]); });
                               }});
    block_.readings.push_back({"positions from the middle", [](ImportedBlock* b) {
                                 for (BlockTiePoint& point : b->points) {
                                   for (BlockObservation& o : point.observations) {
                                     const PinholeCamera& c = b->cameras[b->images[o.image].camera].lens.pinhole;
                                     o.position_px += Eigen::Vector2d(c.width / 2.0, c.height / 2.0);
                                   }
                                 }
                               }});
  }
  void FromTheMiddle() {
    for (BlockTiePoint& point : block_.points) {
      for (BlockObservation& o : point.observations) {
        const PinholeCamera& c = block_.cameras[block_.images[o.image].camera].lens.pinhole;
        o.position_px -= Eigen::Vector2d(c.width / 2.0, c.height / 2.0);
      }
    }
  }
  void SwapTangential() {
    ForEachTruthLens(&block_, [](LensModel& l) { std::swap(l.coefficients[2], l.coefficients[3]); });
  }

  ImportedBlock block_ = ProofTruth(Kind::kOpenCv, 0.3);
};

TEST_F(ReadingsTest, StaysAsReadIfThatFits) {
  const ImportedBlock before = block_;
  const Judged judged = Judge(&block_);
  EXPECT_EQ(judged.Told(), "");
  EXPECT_EQ(block_.cameras[0].lens, before.cameras[0].lens);
  EXPECT_THAT(block_.conventions, IsEmpty());
  ASSERT_EQ(judged.proof.readings.size(), 2u);
  EXPECT_GT(judged.proof.readings[0].residuals.median_px, 0.5);
  EXPECT_FALSE(judged.proof.readings[0].is_applied || judged.proof.readings[1].is_applied);
}

TEST_F(ReadingsTest, TheBetterOneIsApplied) {
  const LensModel truth = block_.cameras[0].lens;
  SwapTangential();
  const Judged judged = Judge(&block_);
  EXPECT_EQ(judged.Told(), "");
  EXPECT_EQ(block_.cameras[0].lens, truth);
  EXPECT_TRUE(judged.proof.is_proven);
  EXPECT_THAT(judged.proof.readings, Contains(Field(&ProofAlternative::is_applied, true)).Times(1));
  EXPECT_THAT(block_.conventions,
              ElementsAre(AllOf(HasSubstr("P1 and P2 as Agisoft writes them"), HasSubstr("instead of"))));
}

TEST_F(ReadingsTest, SeveralAreApplied) {
  const ImportedBlock truth = block_;
  SwapTangential();
  FromTheMiddle();
  const Judged judged = Judge(&block_);
  EXPECT_EQ(judged.Told(), "");
  EXPECT_EQ(block_.cameras[0].lens, truth.cameras[0].lens);
  EXPECT_LT((block_.points[0].observations[0].position_px - truth.points[0].observations[0].position_px).norm(), 1e-9);
  EXPECT_EQ(block_.conventions.size(), 2u);
}

TEST(ProofTest, MissingPositionsAreTriangulated) {
  for (const Kind kind : {Kind::kPinhole, Kind::kBrown}) {
    ImportedBlock block = ProofTruth(kind, 0);
    const ImportedBlock truth = block;
    for (size_t i = 0; i < block.points.size(); ++i) {
      block.points[i].position.setConstant(i % 2 == 0 ? 0 : std::numeric_limits<double>::quiet_NaN());
    }
    // The rays of these images do not intersect.
    const std::vector<BlockObservation> first = {block.points[7].observations[0]};
    block.points[7].observations = first;
    const Judged judged = Judge(&block);
    EXPECT_EQ(judged.Told(), "");
    EXPECT_LT(judged.proof.tie_points.median_px, 1e-4);
    EXPECT_EQ(judged.proof.triangulated, 399);
    EXPECT_EQ(judged.proof.not_triangulated, 1);
    ASSERT_EQ(block.points.size(), 399u);
    EXPECT_THAT(block.left_out, ElementsAre(HasSubstr("1 tie points without a position")));
    for (size_t i = 0; i < 399; ++i) {
      EXPECT_LT((block.points[i].position - truth.points[i < 7 ? i : i + 1].position).norm(), 1e-4);
    }
  }
}

TEST(ProofTest, WrongPosesWithoutPositionsAreRefused) {
  for (const WrongConvention& wrong : kWrongConventions) {
    if (std::string(wrong.name) != "R transposed" && std::string(wrong.name) != "y and z of cameras negated") continue;
    ImportedBlock block = ProofTruth(wrong.kind, 0.3);
    for (BlockTiePoint& point : block.points) point.position.setZero();
    wrong.put(&block);
    const Judged judged = Judge(&block);
    EXPECT_THAT(judged.refusal, HasSubstr(wrong.undone_by)) << wrong.name;
  }
}

TEST(ProofTest, FewObservationsProveNothing) {
  ImportedBlock block = ProofTruth(Kind::kOpenCv, 0);
  block.points.resize(1);
  EXPECT_FALSE(Judge(&block).proof.is_proven);
  EXPECT_EQ(Judge(&block).Told(), "");
  block.points.clear();
  EXPECT_FALSE(Judge(&block).proof.is_proven);
  EXPECT_EQ(ProofToText(Judge(&block).proof, 5), "not proven: no tie points\n");
}

TEST(ProofTest, ImagesWithoutPoseDoNotCount) {
  ImportedBlock block = ProofTruth(Kind::kOpenCv, 0);
  block.images[0].oriented = false;
  block.images[0].centre.setZero();
  block.images[1].camera = -1;
  const Judged judged = Judge(&block);
  EXPECT_EQ(judged.Told(), "");
  EXPECT_EQ(judged.proof.images.size(), 7u);
}

TEST(ProofTest, TextAndJsonHaveTheFigures) {
  ImportedBlock block = ProofTruth(Kind::kOpenCv, 0.3);
  block.images[4].centre += Eigen::Vector3d(0.15, 0, 0);
  block.images[5].rotation_cam_from_block *= -1;  // all its points are behind it
  const Proof proof = MeasureProof(&block, {});
  const std::string text = ProofToText(proof, 3);
  EXPECT_THAT(text, AllOf(HasSubstr("  tie points\n"), HasSubstr("  camera camera 1\n"),
                          HasSubstr("     behind     behind  image images/b/IMG_105.jpg: over three times all\n"),
                          HasSubstr("  image images/a/IMG_104.jpg: over three times all\n"),
                          HasSubstr("and 6 better images\n"), HasSubstr("sample, with ")));
  EXPECT_THAT(text, Not(HasSubstr("control points")));
  const std::string json = ProofToJson(proof);
  EXPECT_THAT(json,
              AllOf(HasSubstr("\"proven\": true"), HasSubstr("\"name\": \"images/a/IMG_104.jpg\""),
                    HasSubstr("\"bad\": true"), HasSubstr("\"median_px\": null"), HasSubstr("\"alternatives\": [\n")));
}

}  // namespace
}  // namespace tessera
