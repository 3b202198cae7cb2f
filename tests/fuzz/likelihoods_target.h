// Likelihoods of a photograph of 16 x 12 pixels and three classes: TIFF, NPY or label PNG.
#pragma once

#include <cmath>
#include <string>

#include "common/imaging/image_io.h"
#include "tests/fuzz/memory_file.h"

namespace tessera {

// The camera of the corpus's images.
inline LensModel SmallLens() {
  LensModel lens;
  lens.kind = LensModel::Kind::kRadial;
  lens.pinhole = {16, 12, 14, 14, 8, 6};
  lens.coefficients[0] = 0.05;
  return lens;
}

// True if they were taken in this form.
inline bool TakesLikelihoods(const std::string& path, const LikelihoodForm& form) {
  const StatusOr<FloatImage> all = ReadLikelihoods(path, 3, SmallLens(), form);
  const StatusOr<LikelihoodPart> part = ReadLikelihoodPart(path, 3, SmallLens(), {5, 4, 9, 8}, form);
  if (!all.ok()) {
    RequireRefusal(all.status());
    return false;
  }
  Require(part.ok(), "a part of what can be read can be read");
  for (size_t i = 0; i < all->plane_size(); ++i) {
    float sum = 0;
    for (int c = 0; c < 3; ++c) {
      Require(all->plane(c)[i] >= 0, "likelihoods are not negative");
      sum += all->plane(c)[i];
    }
    Require(std::abs(sum - 1) < 1e-3, "likelihoods sum to one");
  }
  return true;
}

// True if they were taken.
inline bool RunLikelihoodsTarget(const std::string& bytes) {
  const MemoryFile file(bytes);
  LikelihoodForm other = {LikelihoodForm::Layout::kClassesLast,
                          LikelihoodForm::Values::kLogits,
                          1,
                          {{128, 128, 128}, {128, 0, 128}, {230, 190, 30}}};
  TakesLikelihoods(file.path(), other);
  other.layout = LikelihoodForm::Layout::kClassesFirst;
  TakesLikelihoods(file.path(), other);
  Warnings warnings;
  TakesLikelihoods(file.path(), FindLikelihoodForm({file.path()}, other.colors, {}, &warnings));
  return TakesLikelihoods(file.path(), LikelihoodForm());
}

}  // namespace tessera
