#include "common/synth/labels/noise_calibration.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "common/base/parallel.h"

namespace tessera {

double ClassConfusion::AverageAccuracy() const {
  double sum = 0;
  int classes = 0;
  for (int c = 0; c < kCityClasses; ++c) {
    double all = missing[c];
    for (double w : weight[c]) all += w;
    if (all <= 0) continue;
    sum += weight[c][c] / all;
    ++classes;
  }
  return classes > 0 ? sum / classes : 0;
}

std::vector<StartLabelSample> SampleStartLabels(const CityScene& scene, const std::vector<const StartChunk*>& chunks,
                                                const std::vector<const SynthView*>& views, int rays_per_view,
                                                const BlockRange& range) {
  TriangleMesh start;
  std::vector<std::pair<uint32_t, uint32_t>> origin_of_face;
  for (size_t c = 0; c < chunks.size(); ++c) {
    const uint32_t first = static_cast<uint32_t>(start.vertices.size());
    start.vertices.insert(start.vertices.end(), chunks[c]->vertices.begin(), chunks[c]->vertices.end());
    for (size_t f = 0; f < chunks[c]->faces.size(); ++f) {
      const Triangle& t = chunks[c]->faces[f];
      start.faces.push_back({t[0] + first, t[1] + first, t[2] + first});
      origin_of_face.push_back({static_cast<uint32_t>(c), static_cast<uint32_t>(f)});
    }
  }
  const RayCaster start_caster(start);
  std::vector<std::vector<StartLabelSample>> found(views.size());
  ParallelForEach(views.size(), 1, [&](size_t k) {
    const PosedCamera& camera = views[k]->camera;
    const Eigen::Vector3d centre = camera.Centre();
    const int width = camera.intrinsics.width, height = camera.intrinsics.height;
    const int step =
        std::max(1, static_cast<int>(std::ceil(std::sqrt(static_cast<double>(width) * height / rays_per_view))));
    for (int y = step / 2; y < height; y += step) {
      for (int x = step / 2; x < width; x += step) {
        const Eigen::Vector3d ray = camera.Ray(x + 0.5, y + 0.5);
        const RayHit truth = scene.caster().Cast(centre, ray);
        if (!truth.hit()) continue;
        const Eigen::Vector3d p = centre + truth.distance * ray;
        const auto [column, row] = scene.plan().BlockAt(p.head<2>());
        if (!range.Contains(column, row)) continue;
        const RayHit start_hit = start_caster.Cast(centre, ray);
        StartLabelSample sample{0, StartLabelSample::kNoFace,
                                static_cast<uint8_t>(scene.surface().mesh.labels[truth.face])};
        if (start_hit.hit()) std::tie(sample.chunk, sample.face) = origin_of_face[start_hit.face];
        found[k].push_back(sample);
      }
    }
  });
  std::vector<StartLabelSample> samples;
  for (const auto& part : found) samples.insert(samples.end(), part.begin(), part.end());
  return samples;
}

void AddByArea(const StartChunk& chunk, double threshold, ClassConfusion& confusion) {
  for (size_t f = 0; f < chunk.faces.size(); ++f) {
    const Triangle& t = chunk.faces[f];
    const Eigen::Vector3d& a = chunk.vertices[t[0]];
    const double area = 0.5 * (chunk.vertices[t[1]] - a).cross(chunk.vertices[t[2]] - a).norm();
    confusion.weight[chunk.true_labels[f]][StartLabel(chunk, f, threshold)] += area;
  }
}

ClassConfusion CountByPixels(const std::vector<const StartChunk*>& chunks, const std::vector<StartLabelSample>& samples,
                             double threshold) {
  ClassConfusion confusion;
  for (const StartLabelSample& sample : samples) {
    if (sample.face == StartLabelSample::kNoFace) {
      confusion.missing[sample.true_label] += 1;
    } else {
      confusion.weight[sample.true_label][StartLabel(*chunks[sample.chunk], sample.face, threshold)] += 1;
    }
  }
  return confusion;
}

double CalibrateStartLabels(const std::vector<const StartChunk*>& chunks,
                            const std::vector<StartLabelSample>& samples) {
  double low = -1, high = 6;
  for (int step = 0; step < 16; ++step) {
    const double threshold = 0.5 * (low + high);
    ClassConfusion by_area;
    for (const StartChunk* chunk : chunks) AddByArea(*chunk, threshold, by_area);
    double accuracy = by_area.AverageAccuracy();
    if (!samples.empty()) {
      const double by_pixels = CountByPixels(chunks, samples, threshold).AverageAccuracy();
      accuracy = std::max(accuracy - kStartAreaSlack, 0.5 * (accuracy + by_pixels));
    }
    (accuracy < kStartAverageAccuracy ? low : high) = threshold;
  }
  return 0.5 * (low + high);
}

double CalibrateLikelihoods(const CityScene& scene, const std::vector<const SynthView*>& views,
                            const std::vector<uint64_t>& seeds) {
  std::vector<RenderedView> rendered(views.size());
  std::vector<ViewDoubt> doubts(views.size());
  ParallelForEach(views.size(), 1, [&](size_t k) {
    rendered[k] = RenderView(scene, *views[k], seeds[k], false);
    doubts[k] = PixelDoubt(scene.plan(), rendered[k], seeds[k]);
  });
  std::vector<float> ordered;
  for (size_t k = 0; k < views.size(); ++k) {
    for (size_t i = 0; i < rendered[k].labels.data.size(); i += 7) {
      if (rendered[k].labels.data[i] != 255) ordered.push_back(doubts[k].doubt.data[i]);
    }
  }
  if (ordered.empty()) return 1;
  std::sort(ordered.begin(), ordered.end());
  // Blurred borders reduce the accuracy further, so raise the quantile of the doubt by the missing accuracy.
  double quantile = kLikelihoodArgmaxAccuracy, threshold = 1;
  for (int step = 0; step < 3; ++step) {
    threshold =
        ordered[static_cast<size_t>(std::clamp(quantile, 0.3, 0.9999) * static_cast<double>(ordered.size() - 1))];
    std::vector<ArgmaxCount> counts(views.size());
    ParallelForEach(views.size(), 1, [&](size_t k) {
      counts[k] = CountArgmax(rendered[k], MakeLikelihoods(rendered[k], doubts[k], threshold));
    });
    int64_t right = 0, all = 0;
    for (const ArgmaxCount& count : counts) {
      right += count.right;
      all += count.all;
    }
    quantile += kLikelihoodArgmaxAccuracy - static_cast<double>(right) / static_cast<double>(std::max<int64_t>(all, 1));
  }
  return ordered[static_cast<size_t>(std::clamp(quantile, 0.3, 0.9999) * static_cast<double>(ordered.size() - 1))];
}

}  // namespace tessera
