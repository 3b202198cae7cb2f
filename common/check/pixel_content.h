// The decoded pixels of views: their hashes, digests and what their masks exclude.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/check/label_findings.h"
#include "common/imaging/border_trust.h"
#include "common/scene/scene.h"

namespace tessera {

// XXH3-128 hashes of a view's decoded files; empty if it has no such file.
struct PixelContent {
  std::string image, likelihood;
  double masked_share = 0;  // of the photograph's pixels
};

// Decodes the view's image and its likelihoods of `classes` classes, below `folder`. INVALID_ARGUMENT lists the errors
// of both. `borders` (for `classes` classes; may be null) receives the view's border counts, `digest` (may be null)
// that of its likelihoods. `broken` (may be null) receives an error of the image instead; then the content is empty.
StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders = nullptr, LikelihoodDigest* digest = nullptr,
                                        Status* broken = nullptr);

// Warnings: the share of pixels that masks and alpha channels exclude; images with equal pixels.
void WarnOfContents(const SceneDescription& scene, const std::vector<PixelContent>& contents, Warnings* warnings);

}  // namespace tessera
