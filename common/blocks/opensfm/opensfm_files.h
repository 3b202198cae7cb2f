// The text files of OpenSfM and OpenDroneMap.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "common/base/status.h"
#include "common/blocks/block.h"

namespace tessera {

using OpenSfmIndices = std::unordered_map<std::string_view, int>;  // by the name of a shot or of a track

// Adds the observations of tracks.csv to the points of `block`. The file has a header with the version, then a line an
// observation: shot, track, feature, x, y, [scale from version 1 on,] red, green, blue[, segmentation, instance from
// version 2 on], separated by tabs. Without a header it is of version 0. `images`, `points`: indices into `block`.
void ReadOpenSfmTracks(std::string_view tracks, const OpenSfmIndices& images, const OpenSfmIndices& points,
                       ImportedBlock* block, Faults* faults);

// A projected system, and the offset that was subtracted from eastings and northings, if the file states one.
struct OpenDroneMapGrid {
  std::string crs;
  std::optional<Eigen::Vector2d> offset;
};

// Reads coords.txt, odm_georeferencing_model_geo.txt ("WGS84 UTM 31N", a PROJ string or "EPSG:N", then the offset) or
// proj.txt (a PROJ string). None if `text` is empty, or with a fault if its system cannot be read.
std::optional<OpenDroneMapGrid> ReadOpenDroneMapGrid(const char* file, std::string_view text, Faults* faults);

}  // namespace tessera
