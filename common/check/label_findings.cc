#include "common/check/label_findings.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr int kGrid = 256;            // of a digest
constexpr float kFlat = 0.005f;       // differences of likelihoods below this are rounding to 8 bits
constexpr double kConstantSum = 1.1;  // ratio of the sums of pixels; logits exceed it
constexpr int64_t kSampledFaces = 20000;
constexpr int64_t kJudgedFaces = 300;                    // in all views; fewer say nothing
constexpr double kPoorAgreement = 0.4;                   // of likelihoods and labels; good scenes have 0.7 and more
constexpr double kGoodOrder = 0.65, kBetterOrder = 0.3;  // agreement in another order, and how much better it is
constexpr double kPoorSlopes = 0.3;                      // share of a class's faces that its prior allows
constexpr double kLooksDown = 0.5, kMayLookDown = 0.2;   // cosine of the mean viewing direction and down

// Counts of faces in views.
struct FaceCounts {
  explicit FaceCounts(size_t classes)
      : pairs(classes, std::vector<int64_t>(classes)), faces(classes), allowed(classes) {}
  void Add(const FaceCounts& other) {
    for (size_t a = 0; a < faces.size(); ++a) {
      for (size_t b = 0; b < faces.size(); ++b) pairs[a][b] += other.pairs[a][b];
      faces[a] += other.faces[a];
      allowed[a] += other.allowed[a];
    }
    labelled += other.labelled;
    labels_allowed += other.labels_allowed;
    labels_likely += other.labels_likely;
  }
  std::vector<std::vector<int64_t>> pairs;  // by the face's label and its likeliest class
  std::vector<int64_t> faces, allowed;      // by likeliest class: all, and those with a slope that its prior allows
  int64_t labelled = 0;                     // faces whose label and likeliest class both have a prior
  int64_t labels_allowed = 0, labels_likely = 0;  // of these, those with a slope that the prior of either allows
};

bool HasPrior(const SceneClass& c) { return c.prior_alpha_rad < std::numbers::pi; }

bool Allows(const SceneClass& c, double angle_rad) {
  return std::abs(angle_rad - c.prior_beta_rad) <= c.prior_alpha_rad;
}

// Adds the sampled faces that the view sees, with the class that its likelihoods name at their centroids.
void CountFaces(const SceneDescription& scene, const TriangleMesh& mesh, const RayCaster& caster, const SceneView& view,
                const LabelImage& classes, FaceCounts* counts) {
  const int64_t faces = static_cast<int64_t>(mesh.faces.size());
  const int64_t stride = std::max<int64_t>(1, faces / kSampledFaces);
  const PosedCamera& camera = view.camera;
  const Eigen::Vector3d centre = camera.Centre();
  for (int64_t face = 0; face < faces; face += stride) {
    const Eigen::Vector3d centroid = MeshSpans(mesh).Centroid(face), normal = FaceCross(mesh, face);
    const Eigen::Vector3d projected = camera.Project(centroid);
    if (!camera.InImage(projected) || normal.dot(centroid - centre) >= 0) continue;
    const int x =
        std::min(classes.width - 1, static_cast<int>(projected.x() * classes.width / camera.intrinsics.width));
    const int y =
        std::min(classes.height - 1, static_cast<int>(projected.y() * classes.height / camera.intrinsics.height));
    const int likely = classes.at(x, y);
    if (likely == 255 || caster.Occluded(centre, centroid, 1e-3 * (centroid - centre).norm())) continue;
    const double angle_rad = std::acos(std::clamp(normal.normalized().dot(scene.up_in_local), -1.0, 1.0));
    const bool is_allowed = Allows(scene.classes[likely], angle_rad);
    ++counts->faces[likely];
    counts->allowed[likely] += is_allowed;
    const int32_t label = mesh.labels.empty() ? -1 : mesh.labels[face];
    if (label < 0) continue;
    ++counts->pairs[label][likely];
    if (!HasPrior(scene.classes[label]) || !HasPrior(scene.classes[likely])) continue;
    ++counts->labelled;
    counts->labels_allowed += Allows(scene.classes[label], angle_rad);
    counts->labels_likely += is_allowed;
  }
}

// For each class of the likelihoods the label that most of its faces have. Classes of few faces get the labels that are
// left. Empty if two classes have the same label, or all faces the same class.
std::vector<size_t> OrderOfLabels(const FaceCounts& counts, int64_t all) {
  const size_t classes = counts.faces.size();
  std::vector<size_t> order(classes, classes);
  std::vector<bool> taken(classes);
  for (size_t likely = 0; likely < classes; ++likely) {
    int64_t column = 0;
    size_t best = 0;
    for (size_t label = 0; label < classes; ++label) {
      column += counts.pairs[label][likely];
      if (counts.pairs[label][likely] > counts.pairs[best][likely]) best = label;
    }
    if (column * 200 < all) continue;
    if (taken[best]) return {};
    taken[best] = true;
    order[likely] = best;
  }
  if (std::count(taken.begin(), taken.end(), true) < 2) return {};
  for (size_t likely = 0; likely < classes; ++likely) {
    if (order[likely] < classes) continue;
    const auto left = taken[likely] ? std::find(taken.begin(), taken.end(), false) : taken.begin() + likely;
    order[likely] = static_cast<size_t>(left - taken.begin());
    *left = true;
  }
  return order;
}

// Where likelihoods and labels contradict each other, which of them the slopes fit.
std::string SlopesText(const FaceCounts& counts) {
  if (counts.labelled < kJudgedFaces) return "";
  const int64_t difference = counts.labels_allowed - counts.labels_likely;
  if (5 * std::abs(difference) < counts.labelled) return "";
  return difference > 0 ? " (the slopes of the faces fit the mesh's labels)"
                        : " (the slopes of the faces fit the likelihoods)";
}

Status JudgeAgreement(const SceneDescription& scene, const FaceCounts& counts, Warnings* warnings) {
  int64_t all = 0, same = 0, reordered = 0;
  for (size_t label = 0; label < counts.faces.size(); ++label) {
    for (const int64_t faces : counts.pairs[label]) all += faces;
    same += counts.pairs[label][label];
  }
  if (all < kJudgedFaces) return absl::OkStatus();
  const auto share = [&](int64_t faces) { return static_cast<double>(faces) / static_cast<double>(all); };
  const std::vector<size_t> order = OrderOfLabels(counts, all);
  for (size_t likely = 0; likely < order.size(); ++likely) reordered += counts.pairs[order[likely]][likely];
  const std::string found =
      absl::StrFormat("likelihoods that agree with the mesh's labels at %.0f %% of the visible faces%s",
                      100 * share(same), SlopesText(counts));
  if (share(reordered) >= kGoodOrder && share(reordered - same) >= kBetterOrder) {
    const auto add = [&](std::string* out, size_t label) { out->append(scene.classes[label].name); };
    return InputError(
        absl::StrCat(scene.folder, "/scene.json"), "classes", found,
        absl::StrFormat("the same order of classes everywhere. %.0f %% would agree if the order of the likelihoods' "
                        "classes is %s: bring likelihoods, labels and 'classes' into the same order",
                        100 * share(reordered), absl::StrJoin(order, ", ", add)));
  }
  if (share(same) < kPoorAgreement) {
    warnings->push_back(absl::StrCat("found ", found, ": check that both have the order of 'classes' in scene.json"));
  }
  return absl::OkStatus();
}

void WarnOfSlopes(const SceneDescription& scene, const FaceCounts& counts, Warnings* warnings) {
  for (size_t c = 0; c < counts.faces.size(); ++c) {
    const double share =
        static_cast<double>(counts.allowed[c]) / static_cast<double>(std::max<int64_t>(1, counts.faces[c]));
    if (!HasPrior(scene.classes[c]) || counts.faces[c] < kJudgedFaces || share >= kPoorSlopes) continue;
    warnings->push_back(absl::StrFormat(
        "likelihoods: only %.0f %% of the faces of class '%s' have a slope of this class: check the order of 'classes' "
        "in scene.json, and 'up'",
        100 * share, scene.classes[c].name));
  }
}

}  // namespace

LikelihoodDigest DigestOf(const LikelihoodPart& whole) {
  const FloatImage& image = whole.pixels;
  LikelihoodDigest digest;
  digest.is_read = true;
  digest.low_sum = whole.low_sum;
  digest.high_sum = whole.high_sum;
  // 255 if all classes are equally likely.
  const auto likeliest = [&](size_t i) {
    int best = 0;
    float lowest = image.data[i];
    for (int c = 1; c < image.channels; ++c) {
      const float value = image.plane(c)[i];
      if (value > image.plane(best)[i]) best = c;
      lowest = std::min(lowest, value);
    }
    return image.plane(best)[i] - lowest > kFlat ? best : 255;
  };
  digest.is_flat = image.channels > 1;
  for (size_t i = 0; digest.is_flat && i < image.plane_size(); ++i) digest.is_flat = likeliest(i) == 255;
  digest.classes = LabelImage(std::min(kGrid, image.width), std::min(kGrid, image.height));
  for (int y = 0; y < digest.classes.height; ++y) {
    const size_t row = static_cast<size_t>((y + 0.5) * image.height / digest.classes.height) * image.width;
    for (int x = 0; x < digest.classes.width; ++x) {
      digest.classes.at(x, y) =
          static_cast<uint8_t>(likeliest(row + static_cast<size_t>((x + 0.5) * image.width / digest.classes.width)));
    }
  }
  return digest;
}

bool WarnOfLikelihoodValues(const SceneDescription& scene, const std::vector<LikelihoodDigest>& digests,
                            Warnings* warnings) {
  int64_t read = 0, flat = 0, uneven = 0;
  size_t first_flat = 0;
  double low = 0, high = 0;
  for (size_t v = 0; v < digests.size(); ++v) {
    const LikelihoodDigest& digest = digests[v];
    read += digest.is_read;
    if (digest.is_flat && flat++ == 0) first_flat = v;
    if (digest.high_sum <= kConstantSum * digest.low_sum) continue;
    low = uneven == 0 ? digest.low_sum : std::min(low, digest.low_sum);
    high = std::max(high, digest.high_sum);
    ++uneven;
  }
  if (flat > 0 && flat == read) {
    warnings->push_back(
        absl::StrCat("likelihoods: all classes are equally likely everywhere, in all images, or all values are 0: they "
                     "are ignored",
                     scene.mesh_has_labels ? ", and the mesh's labels stay" : ""));
    return true;
  }
  if (flat > 0) {
    warnings->push_back(absl::StrCat("likelihoods: all classes are equally likely everywhere, or all values are 0, in ",
                                     flat, " of ", read, " images, such as '", scene.views[first_flat].name, "'"));
  }
  const bool is_stated = std::any_of(scene.views.begin(), scene.views.end(), [](const SceneView& view) {
    return view.likelihood_form.values != LikelihoodForm::Values::kUnstated;
  });
  if (uneven > 0 && !is_stated) {
    warnings->push_back(absl::StrFormat(
        "likelihoods: the values of a pixel sum to %.4g to %.4g, expected a constant such as 1, in %d of %d images: if "
        "they are logits, set \"likelihood_values\": \"logits\" in scene.json, else \"probabilities\"",
        low, high, uneven, read));
  }
  return false;
}

void IgnoreLikelihoods(SceneDescription* scene) {
  scene->has_likelihoods = false;
  for (SceneView& view : scene->views) {
    view.likelihood_path.clear();
    view.likelihood_content.clear();
    view.likelihood_form = LikelihoodForm();
  }
  if (!scene->mesh_has_labels) scene->classes = {OneClass()};
}

bool WarnOfUp(const SceneDescription& scene, Warnings* warnings) {
  if (scene.frame.crs().kind != Crs::Kind::kLocal || scene.views.empty()) return false;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const SceneView& view : scene.views) mean += view.camera.rotation_cam_from_world.row(2).transpose();
  mean /= static_cast<double>(scene.views.size());
  if (mean.dot(scene.up_in_local) < -kMayLookDown) return false;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(mean[k]) < kLooksDown) continue;
    const int sign = mean[k] > 0 ? -1 : 1;
    warnings->push_back(absl::StrFormat(
        "scene.json: the cameras do not look down, with %s as up: aerial images would with \"up\": [%d, %d, %d]",
        absl::StrFormat("[%.4g, %.4g, %.4g]", scene.up_in_local.x(), scene.up_in_local.y(), scene.up_in_local.z()),
        k == 0 ? sign : 0, k == 1 ? sign : 0, k == 2 ? sign : 0));
    return true;
  }
  return false;
}

Status JudgeLabels(const SceneDescription& scene, const TriangleMesh& mesh,
                   const std::vector<LikelihoodDigest>& digests, bool has_up, Warnings* warnings) {
  FaceCounts all(scene.classes.size());
  const RayCaster caster(mesh);
  std::mutex mutex;
  ParallelForEach(static_cast<int64_t>(digests.size()), 1, [&](int64_t v) {
    if (digests[v].classes.empty()) return;
    FaceCounts of_view(scene.classes.size());
    CountFaces(scene, mesh, caster, scene.views[v], digests[v].classes, &of_view);
    std::lock_guard lock(mutex);
    all.Add(of_view);
  });
  if (!mesh.labels.empty()) return JudgeAgreement(scene, all, warnings);
  if (has_up) WarnOfSlopes(scene, all, warnings);
  return absl::OkStatus();
}

}  // namespace tessera
