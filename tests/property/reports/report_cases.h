// The scenes of public reports, and what is expected of each: one line a case.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tests/support/bent_scene/bent_scene.h"

namespace tessera {

enum class Expect {
  kGood,     // usable, without a warning
  kTold,     // usable, with a warning that has all the words; without words: with any warnings or none
  kRefused,  // INVALID_ARGUMENT with all the words: the fault, and what to do
};

// A good scene as which the scene must be read: the same views and decoded files, and the same labelled triangles.
enum class Like { kNone, kBase, kPlainNpy, kPlainLabels };

struct ReportCase {
  const char* name;  // of the report
  void (*bend)(const std::string& scene);
  Expect expect = Expect::kGood;
  std::vector<std::string> words = {};  // in any case of letters
  Like like = Like::kNone;
};

inline void PrintTo(const ReportCase& report, std::ostream* out) { *out << report.name; }

// clang-format off
inline const std::vector<ReportCase>& ReportCases() {
  using enum Expect;
  using enum Like;
  static const std::vector<ReportCase> cases = {
      // Cameras and names.
      {"01-no-points-lines", bent::NoPointsLines, kGood, {}, kBase},
      {"02-realityscan-text", bent::RealityScanText, kGood, {}, kBase},
      {"03-nan-ind-camera", bent::NanIndCamera, kGood, {}, kBase},
      {"04-five-params", bent::FiveParameters, kRefused, {"cameras.txt", "5 parameters", "RADIAL"}},
      {"06-sub-models", bent::SubModels, kTold, {"models", "15 images"}, kBase},
      {"07-fisheye-text", bent::FisheyeText, kRefused, {"OPENCV_FISHEYE", "EUCM", "image_undistorter"}},
      {"08-fisheye-binary", bent::FisheyeBinary, kRefused, {"RAD_TAN_THIN_PRISM_FISHEYE", "image_undistorter"}},
      {"09-backslashes", bent::Backslashes, kTold, {}, kBase},
      {"10-case-of-extension", bent::CaseOfExtension, kTold, {"nadir_00_000.JPG"}, kBase},
      {"11-one-image-missing", bent::OneImageMissing, kRefused, {"south_00_000.jpg", "--skip-images"}},
      {"12-non-ascii-names", bent::NonAsciiNames, kGood, {}, kBase},
      {"13-half-size-images", bent::HalfSizeImages, kTold, {"scaled", "200 x 150"}},
      {"14-camera-to-world", bent::CameraToWorld, kRefused, {"camera-to-world", "invert"}},
      {"15-quaternion-xyzw", bent::QuaternionXyzw, kRefused, {"quaternions", "w x y z"}},
      {"16-opengl-cameras", bent::OpenGlCameras, kRefused, {"OpenGL"}},
      {"17-stale-rig-poses", bent::StaleRigPoses, kRefused, {"frames", "images"}},
      {"18-old-binary-beside-text", bent::OldBinaryBesideText, kTold, {"newer"}, kBase},
      {"19-lfs-pointers", bent::LfsPointers, kRefused, {"Git LFS", "mesh.ply", "images.bin", "git lfs pull"}},
      {"83-one-image", bent::OneImage, kTold, {"1 image"}},
      {"84-two-images", bent::TwoImages, kTold, {"2 images"}},
      {"89-jpg-and-png-of-one-stem", bent::JpgAndPngOfOneStem, kRefused, {"east_00_000.png", "likelihoods"}},
      {"90-names-with-dot-slash", bent::NamesWithDotSlash, kGood, {}, kBase},
      {"91-byte-order-mark", bent::ByteOrderMark, kGood, {}, kBase},
      {"92-many-missing", bent::ManyMissing, kRefused, {"DJI_00000", "600", "images"}},
      {"93-same-photo-twice", bent::SamePhotoTwice, kTold, {"same pixels"}},
      {"102-gap-in-image-points", bent::GapInImagePoints, kTold, {}, kBase},
      // Photographs.
      {"21-exif-orientation", bent::ExifOrientation, kTold, {"orientation", "15"}, kBase},
      {"22-turned-portrait", bent::TurnedPortrait, kRefused, {"nadir_00_000.jpg", "300 x 400", "400 x 300"}},
      {"24-tiff-16bit", bent::Tiff16Bit12, kTold, {"16 bits"}},
      {"24b-tiff-16bit-full", bent::Tiff16BitFull, kGood},
      {"25-tiff-float", bent::TiffFloat, kRefused, {"nadir_00_000.tif", "float", "8"}},
      {"27-tiff-four-bands", bent::TiffFourBands, kTold, {}},
      {"28-truncated-jpeg", bent::TruncatedJpeg, kRefused, {"north_00_000.jpg", "end of the file"}},
      {"29-zero-bytes", bent::ZeroBytes, kRefused, {"north_00_000.jpg", "empty file"}},
      {"30-damaged-inside", bent::DamagedInside, kRefused, {"nadir_00_000.jpg", "damaged"}},
      {"32-grey-progressive-palette", bent::GreyProgressivePalette, kGood},
      {"33-transparent-masks", bent::TransparentMasks, kTold, {"mask"}},
      {"34-black-rims", bent::BlackRims, kTold, {}},
      // A quarter of the pixels takes a quarter of the time. Whether the memory suffices depends on the machine.
      {"35-hundred-megapixels", bent::TwentyFiveMegapixels, kGood},
      // Likelihoods.
      {"36-npy-float64-hwc", bent::NpyFloat64Hwc, kTold, {}, kPlainNpy},
      {"37-npy-hwc-float32", bent::NpyHwcFloat32, kTold, {}, kPlainNpy},
      {"39-npy-logits", bent::NpyLogits, kRefused, {"nadir_00_000.npy", "logits"}},
      {"40-npy-logits-shifted", bent::NpyLogitsShifted, kTold, {"logits"}},
      {"41-npy-argmax-int64", bent::NpyArgmaxInt64, kTold, {}, kPlainLabels},
      {"42-npy-batch-axis", bent::NpyBatchAxis, kTold, {}, kPlainNpy},
      {"43-palette-labels", bent::PaletteLabels, kTold, {}, kPlainLabels},
      {"44-colour-labels", bent::ColourLabels, kTold, {}, kPlainLabels},
      {"45-labels-from-one", bent::LabelsFromOne, kTold, {"from 1"}, kPlainLabels},
      {"47-upper-case-suffix", bent::UpperCaseSuffix, kTold, {}, kBase},
      {"48-nan-and-zero", bent::NanAndZero, kRefused, {"north_00_000.npy", "class 2", "NaN"}},
      {"49-all-zero-files", bent::AllZeroFiles, kTold, {"likelihoods"}},
      {"50-classes-in-another-order", bent::ClassesInAnotherOrder, kRefused, {"order", "facade, ground", "--anyway"}},
      {"51-half-of-the-likelihoods", bent::HalfOfTheLikelihoods, kRefused, {"likelihoods", "nadir_00_000.jpg"}},
      {"52-square-512", bent::Square512, kRefused, {"512 x 512", "400 x 300", "aspect ratio"}},
      // The mesh.
      {"54-sum-labels-likelihoods-ok", bent::SumLabels, kTold, {}},
      {"55-quads", bent::Quads, kTold, {"split"}, kBase},
      {"56-one-face-short", bent::OneFaceShort, kRefused, {"mesh.ply", "end of the file"}},
      {"57-crlf-binary-header", bent::CrlfBinaryHeader, kGood, {}, kBase},
      {"58-big-endian-double-header-extras", bent::BigEndianHeaderExtras, kGood, {}, kBase},
      {"59-float-utm", bent::FloatUtm, kRefused, {"mesh.ply", "32-bit floats", "doubles"}},
      {"60-double-utm", bent::DoubleUtm, kGood},
      {"61-offset-not-applied", bent::OffsetNotApplied, kRefused, {"mesh.ply", "offset"}},
      {"62-mesh-in-feet", bent::MeshInFeet, kRefused, {"feet", "0.3048"}},
      {"65-scene-y-down", bent::SceneYDown, kTold, {"up", "-1"}},
      {"65b-scene-z-down", bent::SceneZDown, kTold, {"up", "-1"}},
      {"67-no-labels-z-up", bent::NoLabels, kTold, {"neither labels nor likelihoods"}},
      {"68-scale-hundredth", bent::ScaleHundredth, kGood},
      {"69-scale-thousand", bent::ScaleThousand, kGood},
      {"70-triangle-soup", bent::TriangleSoup, kTold, {"vertices", "same place"}},
      {"72-tile-borders", bent::TileBorders, kTold, {"vertices", "same place"}},
      {"73-poisson-bubble", bent::PoissonBubble, kTold, {}},
      {"74-floating-bits", bent::FloatingBits, kTold, {"duplicate faces"}},
      {"75-inside-out", bent::InsideOut, kTold, {"turned", "inwards"}},
      {"77-nan-vertex", bent::NanVertex, kRefused, {"mesh.ply", "vertex 17", "finite"}},
      {"78-point-cloud", bent::PointCloud, kRefused, {"mesh.ply", "no element 'face'"}},
      {"79-labels-on-vertices", bent::LabelsOnVertices, kTold, {"scalar_label"}},
      {"80-label-as-float", bent::LabelAsFloat, kGood, {}, kBase},
      {"85-one-face", bent::OneFace, kTold, {"mesh.ply"}},
      {"87-empty-mesh", bent::EmptyMesh, kRefused, {"mesh.ply", "no faces"}},
      {"88-obj-called-ply", bent::ObjCalledPly, kTold, {}},
      {"98-spike-of-a-kilometre", bent::SpikeOfAKilometre, kTold, {"vertex 1000"}},
      {"101-more-classes-than-names", bent::MoreClassesThanNames, kRefused, {"mesh.ply", "label 4", "classes"}},
      // Named in the same reports, without a scene of their own.
      {"principal-point-at-zero", bent::PrincipalPointAtZero, kRefused, {"principal point"}},
      {"axes-exchanged", bent::AxesExchanged, kRefused, {"map (x, y, z) to (y, x, z)", "--anyway"}},
      {"vertex-at-origin", bent::VertexAtOrigin, kTold, {"vertex 1000"}},
  };
  return cases;
}
// clang-format on

}  // namespace tessera
