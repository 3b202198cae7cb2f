// OpenSfM reconstructions, and the project folders of OpenDroneMap around them.
#pragma once

#include <string>
#include <string_view>

#include "common/blocks/block_format.h"

namespace tessera {

// Whether `path` is a folder of OpenDroneMap (with opensfm/) or OpenSfM, or a file with reconstructions of OpenSfM.
bool IsOpenSfm(const std::string& path);

// Of a folder, reads reconstruction.topocentric.json, else reconstruction.json, and of a project also the files of
// odm_georeferencing and odm_report. options.component: index of the reconstruction. Tie points are those of tracks.csv
// beside it. Paths of images that lie in the folder images of the project are absolute.
ImportedBlock ReadOpenSfm(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings* warnings);

// The contents of the files, for tests and fuzzing. Empty: there is no such file.
struct OpenSfmFiles {
  std::string path = "reconstruction.json";  // for messages; the names of the others are fixed
  std::string_view reconstructions;
  std::string_view tracks;         // tracks.csv
  std::string_view reference_lla;  // reference_lla.json
  std::string_view shots;          // odm_report/shots.geojson
  std::string_view coords;         // odm_georeferencing/coords.txt
  std::string_view model_geo;      // odm_georeferencing/odm_georeferencing_model_geo.txt
  std::string_view proj;           // odm_georeferencing/proj.txt
  bool topocentric = false;        // the file is reconstruction.topocentric.json
  bool projected = false;          // the file is reconstruction.json beside a reconstruction.topocentric.json
};
ImportedBlock ParseOpenSfm(const OpenSfmFiles& files, const BlockReadOptions& options, Faults* faults,
                           Warnings* warnings);

}  // namespace tessera
