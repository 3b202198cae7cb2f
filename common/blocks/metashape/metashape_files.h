// The documents of a PhotoScan or Metashape project.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/storage/xml_file.h"

namespace tessera {

struct MetashapeFiles {
  std::vector<XmlFile> documents;  // own the nodes
  std::string version;             // of the document
  XmlNode chunk;                   // no node: the project could not be read
  XmlNode frame;                   // with the photographs' paths; no node if there is none
  XmlNode point_cloud;             // with the paths of tie points; no node if there is none
  std::string photo_folder;        // of relative paths; empty: that of the project
  std::function<StatusOr<std::string>(const std::string& member)> read_points;  // files that point_cloud names
  std::vector<std::string> files;                                               // absolute
};

// Whether `path` holds such documents, by their content.
bool HasMetashapeFiles(const std::string& path);

// Adds faults for what is missing or damaged; missing tie points are a warning.
MetashapeFiles OpenMetashapeFiles(const std::string& path, Faults* faults, Warnings* warnings);

// The same of an XML or a .psz in memory.
MetashapeFiles ParseMetashapeFiles(std::string bytes, const std::string& name, Faults* faults, Warnings* warnings);

}  // namespace tessera
