#include "common/imaging/pyramid.h"

#include <opencv2/imgproc.hpp>
#include <utility>

namespace tessera {

FloatImage HalfResolution(const FloatImage& image) {
  FloatImage half((image.width + 1) / 2, (image.height + 1) / 2, image.channels);
  for (int c = 0; c < image.channels; ++c) {
    // OpenCV takes a non-const pointer for input too, and does not write to it.
    const cv::Mat from(image.height, image.width, CV_32F, const_cast<float*>(image.plane(c)));
    cv::Mat to(half.height, half.width, CV_32F, half.plane(c));
    cv::resize(from, to, to.size(), 0, 0, cv::INTER_AREA);
  }
  return half;
}

std::vector<FloatImage> BuildPyramid(FloatImage image, int levels) {
  std::vector<FloatImage> pyramid;
  if (image.empty() || levels < 1) return pyramid;
  pyramid.push_back(std::move(image));
  while (static_cast<int>(pyramid.size()) < levels && pyramid.back().width > 1 && pyramid.back().height > 1) {
    pyramid.push_back(HalfResolution(pyramid.back()));
  }
  return pyramid;
}

}  // namespace tessera
