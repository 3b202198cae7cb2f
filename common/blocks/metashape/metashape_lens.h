// The sensors of PhotoScan and Metashape.
#pragma once

#include "common/blocks/block.h"
#include "common/storage/xml_file.h"

namespace tessera {

// Reads a sensor's size and calibration into `camera`. False with faults if it is not read: other types than frame, no
// calibration, wrong values. `old_form`: set if the calibration has <fx>, as before PhotoScan 1.3.
bool ReadMetashapeSensor(const XmlNode& sensor, BlockCamera* camera, bool* old_form, Faults* faults);

}  // namespace tessera
