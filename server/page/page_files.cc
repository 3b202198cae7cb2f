#include "server/page/page_files.h"

#include <cstddef>

namespace tessera {

// In the file that server/page/embed writes.
extern const size_t kPageFileCount;
const PageFile* EmbeddedPageFiles();

const std::vector<PageFile>& PageFiles() {
  static const std::vector<PageFile> kFiles(EmbeddedPageFiles(), EmbeddedPageFiles() + kPageFileCount);
  return kFiles;
}

}  // namespace tessera
