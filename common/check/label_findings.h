// Whether likelihoods, the mesh's labels, the classes and the up direction of a scene go together.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/imaging/image_io.h"
#include "common/scene/scene.h"

namespace tessera {

// What the likelihoods of a view hold, in short.
struct LikelihoodDigest {
  bool is_read = false;
  bool is_flat = false;  // all classes are equally likely at each pixel
  // The likeliest class on a grid of at most 256 x 256 pixels over the undistorted image, 255 where there is none.
  LabelImage classes;
  double low_sum = 0, high_sum = 0;  // as LikelihoodPart
};

// `whole`: likelihoods of a whole image.
LikelihoodDigest DigestOf(const LikelihoodPart& whole);

// Warns of likelihoods that prefer no class, and of values that are probably logits. True if no image's likelihoods
// prefer a class: they should be ignored (IgnoreLikelihoods). `digests`: of each view.
bool WarnOfLikelihoodValues(const SceneDescription& scene, const std::vector<LikelihoodDigest>& digests,
                            Warnings* warnings);

// Makes it a scene without likelihoods. Without labels too, it has one class.
void IgnoreLikelihoods(SceneDescription* scene);

// Warns if the cameras do not look down and would with another axis as up. Returns whether it did. Only for coordinate
// systems in which scene.json sets the up direction.
bool WarnOfUp(const SceneDescription& scene, Warnings* warnings);

// INVALID_ARGUMENT if likelihoods and the labels of the repaired start mesh disagree, but agree in another order of
// classes, which it names. Warns if they disagree in any order. For a mesh without labels: warns if the slopes of faces
// contradict the priors of their likeliest classes, if `has_up`. Compares up to 20,000 faces in all views with a
// digest. The result does not depend on the number of threads.
Status JudgeLabels(const SceneDescription& scene, const TriangleMesh& mesh,
                   const std::vector<LikelihoodDigest>& digests, bool has_up, Warnings* warnings);

}  // namespace tessera
