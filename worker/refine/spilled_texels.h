// Texels on disk while nobody looks at them.
#ifndef TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_
#define TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_

#include <string>

#include "common/base/status.h"
#include "common/storage/mapped_file.h"
#include "worker/refine/texels.h"

namespace tessera {

// The arrays of one view's texels in a file without a name. Const members are thread-safe.
class SpilledTexels {
 public:
  SpilledTexels() = default;  // of none
  // Takes the arrays out of `texels`, which keeps everything else. RESOURCE_EXHAUSTED if the disk of `folder` is full.
  static StatusOr<SpilledTexels> Spill(const std::string& folder, Texels* texels);
  // Puts a copy of them back.
  void Bring(Texels* texels) const;

 private:
  MappedFile file_;
  size_t pixels_ = 0, planes_ = 0;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_
