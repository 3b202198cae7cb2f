// Camera parameters and tie points of Pix4D.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/block_format.h"

namespace tessera {

bool IsPix4d(const std::string& path);

// `path`: a file calibrated_camera_parameters.txt, or a folder that has one, such as PROJECT/1_initial/params. Reads
// the files of the same project beside it: offset.xyz, else the offset from calibrated_external_camera_parameters.txt;
// wkt.prj; pmatrix.txt, which must agree; tp_pix4d.txt, whose points are triangulated.
ImportedBlock ReadPix4d(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings* warnings);

// Parses the text of the file calibrated_camera_parameters.txt called `name` and adds its cameras and images.
void ParsePix4dCameras(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults);
// Compares the projection matrices of pmatrix.txt with those of the cameras.
void ComparePix4dMatrices(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults);
// Sets the offset from positions in the coordinate system: calibrated_external_camera_parameters.txt.
void ParsePix4dPositions(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults);

}  // namespace tessera
