#include "worker/refine/spilled_texels.h"

#include <algorithm>
#include <cstring>

namespace tessera {

StatusOr<SpilledTexels> SpilledTexels::Spill(const std::string& folder, Texels* texels) {
  SpilledTexels out;
  out.pixels_ = texels->luminance.size();
  out.planes_ = texels->likelihoods.size();
  out.rect_ = {texels->x0, texels->y0, texels->x0 + texels->width, texels->y0 + texels->height};
  out.stride_ = texels->stride;
  out.classes_ = texels->classes;
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

void SpilledTexels::Bring(const PixelRect& rect, Texels* texels) const {
  texels->x0 = rect.x0;
  texels->y0 = rect.y0;
  texels->width = rect.width();
  texels->height = rect.height();
  texels->stride = PaddedStride(texels->width);
  texels->classes = classes_;
  const ptrdiff_t skipped = static_cast<ptrdiff_t>(rect.y0 - rect_.y0) * stride_ + (rect.x0 - rect_.x0);
  const auto copy = [&](const auto* from, auto* to) {
    to->assign(static_cast<size_t>(texels->stride) * (texels->height + 1), 0);
    for (int y = 0; y < texels->height; ++y) {
      const auto* row = from + skipped + static_cast<ptrdiff_t>(y) * stride_;
      std::copy_n(row, texels->width, to->data() + texels->Index(0, y));
    }
  };
  const char* from = file_.data();
  copy(reinterpret_cast<const uint16_t*>(from), &texels->luminance);
  texels->likelihoods.resize(planes_);
  for (size_t p = 0; p < planes_; ++p) {
    // The luminance of whole pixel blocks takes a multiple of four bytes.
    const size_t at = pixels_ * sizeof(uint16_t) + p * pixels_ * sizeof(uint32_t);
    copy(reinterpret_cast<const uint32_t*>(from + at), &texels->likelihoods[p]);
  }
  file_.Release(0, file_.size_bytes());
}

}  // namespace tessera
