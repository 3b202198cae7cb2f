// Reference systems of PhotoScan and Metashape.
#pragma once

#include <string>
#include <string_view>

namespace tessera {

// The earth-centred system on the datum of `wkt` (WKT 1: GEOGCS, PROJCS, COMPD_CS or GEOCCS): "EPSG:4978" for WGS 84,
// "EPSG:4936" for ETRS89, else WKT. Empty for local systems and unknown text.
std::string GeocentricOf(std::string_view wkt);

}  // namespace tessera
