// Scenes as producers have them, each made from a good scene by one change. Every function edits the copy of the base
// scene in the folder `scene` (MakeBaseScene) and aborts the test if it cannot. The names are those of the reports.
#pragma once

#include <string>

namespace tessera::bent {

// The good scene: a city of one block with 15 photographs of 400 x 300 pixels, GSD 0.3 m, likelihoods, labels and
// truth. Made once per process; the folder must not be changed.
const std::string& BaseScene();

// Copies the base scene, without its truth, to `scene`, which must not exist.
void CopyBaseScene(const std::string& scene);

// Cameras and names of images (bent_cameras.cc, bent_names.cc).
void NoPointsLines(const std::string& scene);    // images.txt with one line an image
void RealityScanText(const std::string& scene);  // CRLF, exponents of three digits, names with blanks
void NanIndCamera(const std::string& scene);     // an unused camera with parameters -nan(ind)
void FiveParameters(const std::string& scene);   // SIMPLE_RADIAL with five
void SubModels(const std::string& scene);        // colmap/0, colmap/1
void FisheyeText(const std::string& scene);      // OPENCV_FISHEYE and EUCM
void FisheyeBinary(const std::string& scene);    // RAD_TAN_THIN_PRISM_FISHEYE
void Backslashes(const std::string& scene);      // north\a.jpg
void CaseOfExtension(const std::string& scene);  // a.JPG for a.jpg
void OneImageMissing(const std::string& scene);  // south_00_000.jpg
void NonAsciiNames(const std::string& scene);
void HalfSizeImages(const std::string& scene);       // but cameras of full size
void CameraToWorld(const std::string& scene);        // inverse poses
void QuaternionXyzw(const std::string& scene);       // quaternions with w last
void OpenGlCameras(const std::string& scene);        // y up, z backwards
void StaleRigPoses(const std::string& scene);        // images.txt differs from frames.txt
void OldBinaryBesideText(const std::string& scene);  // with cameras 10 m higher
void LfsPointers(const std::string& scene);          // of the mesh, the model and an image
void GapInImagePoints(const std::string& scene);     // empty lines of points, no last line
void OneImage(const std::string& scene);
void TwoImages(const std::string& scene);
void JpgAndPngOfOneStem(const std::string& scene);    // with one likelihood file for both
void NamesWithDotSlash(const std::string& scene);     // ./a.jpg
void ByteOrderMark(const std::string& scene);         // in all text files
void ManyMissing(const std::string& scene);           // 600 images without files
void SamePhotoTwice(const std::string& scene);        // each photograph under two names
void PrincipalPointAtZero(const std::string& scene);  // of all cameras

// Photographs (bent_images.cc).
void ExifOrientation(const std::string& scene);  // a tag that viewers apply; the pixels are right
void TurnedPortrait(const std::string& scene);   // one photograph turned by 90 degrees
void Tiff16Bit12(const std::string& scene);      // 12 bits in 16
void Tiff16BitFull(const std::string& scene);
void TiffFloat(const std::string& scene);                      // one photograph
void TiffFourBands(const std::string& scene);                  // the fourth is near infrared
void TruncatedJpeg(const std::string& scene);                  // north_00_000.jpg
void ZeroBytes(const std::string& scene);                      // north_00_000.jpg
void DamagedInside(const std::string& scene);                  // 4 KiB of zeros in every third JPEG
void GreyProgressivePalette(const std::string& scene);         // five photographs in other forms
void TransparentMasks(const std::string& scene);               // PNG, transparent outside an ellipse
void BlackMasks(const std::string& scene);                     // the same without transparency
void BlackRims(const std::string& scene);                      // of an undistortion
void LargePhotograph(const std::string& scene, int width_px);  // one of this width, with its camera
void HundredMegapixels(const std::string& scene);              // one of 11648 x 8736 pixels
void TwentyFiveMegapixels(const std::string& scene);           // one of 5824 x 4368 pixels

// Likelihoods (bent_likelihoods.cc). PlainNpy and PlainLabels are good scenes to compare others with.
void PlainNpy(const std::string& scene);     // float32, classes x height x width
void PlainLabels(const std::string& scene);  // grey PNG of class ids
void NpyFloat64Hwc(const std::string& scene);
void NpyHwcFloat32(const std::string& scene);
void NpyLogits(const std::string& scene);         // with negative values
void NpyLogitsShifted(const std::string& scene);  // 0 to 7
void NpyArgmaxInt64(const std::string& scene);    // height x width
void NpyBatchAxis(const std::string& scene);      // 1 x classes x height x width
void PaletteLabels(const std::string& scene);
void ColourLabels(const std::string& scene);     // in the colours of the classes
void LabelsFromOne(const std::string& scene);    // ids 1 to 4
void UpperCaseSuffix(const std::string& scene);  // a.TIF
void NanAndZero(const std::string& scene);       // zeros in one file, a NaN in north_00_000.npy
void AllZeroFiles(const std::string& scene);
void ClassesInAnotherOrder(const std::string& scene);  // facade, ground, vegetation, roof
void HalfOfTheLikelihoods(const std::string& scene);   // every second file
void Square512(const std::string& scene);              // 512 x 512 pixels for 400 x 300

// Labels of the mesh (bent_mesh.cc).
void MoreClassesThanNames(const std::string& scene);  // 2 to 5
void SumLabels(const std::string& scene);             // another numbering; likelihoods are right
void NoLabels(const std::string& scene);              // nor likelihoods
void LabelsOnVertices(const std::string& scene);      // scalar_label; no likelihoods
void LabelAsFloat(const std::string& scene);

// The mesh's file (bent_mesh_files.cc).
void Quads(const std::string& scene);
void OneFaceShort(const std::string& scene);  // the header counts one more
void CrlfBinaryHeader(const std::string& scene);
void BigEndianHeaderExtras(const std::string& scene);  // with elements and lists that other programs write
void NanVertex(const std::string& scene);              // vertex 17
void PointCloud(const std::string& scene);             // no faces
void EmptyMesh(const std::string& scene);              // 0 faces
void ObjCalledPly(const std::string& scene);
void FloatUtm(const std::string& scene);  // a float mesh at UTM coordinates
void DoubleUtm(const std::string& scene);

// The mesh itself (bent_mesh.cc).
void OffsetNotApplied(const std::string& scene);  // cameras in UTM, the mesh near the origin
void MeshInFeet(const std::string& scene);
void AxesExchanged(const std::string& scene);   // x and y of the mesh
void SceneYDown(const std::string& scene);      // no `up`
void SceneZDown(const std::string& scene);      // no `up`
void ScaleHundredth(const std::string& scene);  // all in units of 100 m
void ScaleThousand(const std::string& scene);   // all in millimetres
void TriangleSoup(const std::string& scene);    // each face has its own vertices
void TileBorders(const std::string& scene);     // four tiles with their own vertices
void PoissonBubble(const std::string& scene);   // a closed surface of large faces around the city
void FloatingBits(const std::string& scene);    // small pieces, fins, repeated and degenerate faces
void InsideOut(const std::string& scene);
void OneFace(const std::string& scene);
void SpikeOfAKilometre(const std::string& scene);  // vertex 1000
void VertexAtOrigin(const std::string& scene);     // of a scene at UTM coordinates

// Annotations for `tessera classify` of four images, made from the truth, in a new folder (bent_annotations.cc).
// `form`: ids, colours, jpeg-colours, antialiased, palette, double-suffix or half-size.
void PaintAnnotations(const std::string& folder, const std::string& form);

}  // namespace tessera::bent
