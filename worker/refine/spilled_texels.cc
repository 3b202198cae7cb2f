#include "worker/refine/spilled_texels.h"

#include <algorithm>
#include <cstring>

namespace tessera {

StatusOr<SpilledTexels> SpilledTexels::Spill(const std::string& folder, Texels* texels) {
  SpilledTexels out;
  out.pixels_ = texels->luminance.size();
  out.planes_ = texels->likelihoods.size();
  const size_t luminance_bytes = out.pixels_ * sizeof(uint16_t), plane_bytes = out.pixels_ * sizeof(uint32_t);
  TESSERA_ASSIGN_OR_RETURN(out.file_, MappedFile::Scratch(folder, luminance_bytes + out.planes_ * plane_bytes));
  char* to = out.file_.mutable_data();
  if (out.pixels_ > 0) std::memcpy(to, texels->luminance.data(), luminance_bytes);
  for (size_t p = 0; p < out.planes_; ++p) {
    std::memcpy(to + luminance_bytes + p * plane_bytes, texels->likelihoods[p].data(), plane_bytes);
  }
  out.file_.Release(0, out.file_.size_bytes());
  texels->luminance = LineVector<uint16_t>();
  texels->likelihoods.clear();
  return out;
}

void SpilledTexels::Bring(Texels* texels) const {
  const size_t luminance_bytes = pixels_ * sizeof(uint16_t), plane_bytes = pixels_ * sizeof(uint32_t);
  const char* from = file_.data();
  const auto* luminance = reinterpret_cast<const uint16_t*>(from);
  texels->luminance.assign(luminance, luminance + pixels_);
  texels->likelihoods.resize(planes_);
  for (size_t p = 0; p < planes_; ++p) {
    // The luminance of whole pixel blocks takes a multiple of four bytes.
    const auto* plane = reinterpret_cast<const uint32_t*>(from + luminance_bytes + p * plane_bytes);
    texels->likelihoods[p].assign(plane, plane + pixels_);
  }
  file_.Release(0, file_.size_bytes());
}

}  // namespace tessera
