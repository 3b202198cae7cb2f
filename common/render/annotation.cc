#include "common/render/annotation.h"

#include <absl/strings/str_format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/render/coloring.h"

namespace tessera {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

// Calls `draw` with an interleaved copy of `image` and copies the result back.
template <class Draw>
void OnCanvas(ByteImage* image, const Draw& draw) {
  std::vector<cv::Mat> planes;
  for (int c = 0; c < 3; ++c) planes.emplace_back(image->height, image->width, CV_8U, image->plane(c));
  cv::Mat canvas;
  cv::merge(planes, canvas);
  draw(canvas);
  cv::split(canvas, planes);  // writes into the image's memory, because sizes and types are equal
}

// Font scale for the height of the image.
double FontScale(const cv::Mat& canvas) { return std::clamp(canvas.rows / 1000.0, 0.4, 2.0); }

void DrawText(cv::Mat& canvas, const std::string& text, cv::Point baseline, double scale) {
  const int thickness = std::max(1, static_cast<int>(std::lround(2 * scale)));
  cv::putText(canvas, text, baseline, kFont, scale, cv::Scalar(255, 255, 255), thickness + 3, cv::LINE_AA);
  cv::putText(canvas, text, baseline, kFont, scale, cv::Scalar(20, 20, 20), thickness, cv::LINE_AA);
}

}  // namespace

ByteImage SideBySide(const ByteImage& left, const ByteImage& right) {
  const int gap = std::max(2, left.height / 100);
  ByteImage both(left.width + gap + right.width, left.height, 3, 255);
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < left.height; ++y) {
      std::copy_n(&left.at(0, y, c), left.width, &both.at(0, y, c));
      std::copy_n(&right.at(0, y, c), right.width, &both.at(left.width + gap, y, c));
    }
  }
  return both;
}

void DrawCaption(ByteImage* image, const std::string& text) {
  OnCanvas(image, [&](cv::Mat& canvas) {
    const double scale = FontScale(canvas);
    const int margin = static_cast<int>(12 * scale + 4);
    DrawText(canvas, text, {margin, margin + static_cast<int>(24 * scale)}, scale);
  });
}

void DrawLegend(ByteImage* image, const std::vector<std::pair<std::string, std::array<uint8_t, 3>>>& entries) {
  OnCanvas(image, [&](cv::Mat& canvas) {
    const double scale = 0.8 * FontScale(canvas);
    const int box = static_cast<int>(26 * scale), step = static_cast<int>(38 * scale);
    int y = canvas.rows - step * static_cast<int>(entries.size()) - box / 2;
    for (const auto& [name, rgb] : entries) {
      const cv::Rect swatch(box / 2, y, box, box);
      cv::rectangle(canvas, swatch, cv::Scalar(rgb[0], rgb[1], rgb[2]), cv::FILLED);
      cv::rectangle(canvas, swatch, cv::Scalar(60, 60, 60), 1);
      DrawText(canvas, name, {2 * box, y + box - static_cast<int>(3 * scale)}, scale);
      y += step;
    }
  });
}

void DrawDisplacementBar(ByteImage* image, double range_m) {
  OnCanvas(image, [&](cv::Mat& canvas) {
    const double scale = 0.7 * FontScale(canvas);
    const int width = canvas.cols / 2, height = static_cast<int>(24 * scale) + 2;
    const int left = (canvas.cols - width) / 2, top = canvas.rows - static_cast<int>(70 * scale) - height;
    for (int x = 0; x < width; ++x) {
      const Color color = 255.f * DivergingColor(2.0 * x / std::max(1, width - 1) - 1);
      cv::line(canvas, {left + x, top}, {left + x, top + height}, cv::Scalar(color[0], color[1], color[2]));
    }
    cv::rectangle(canvas, {left - 1, top - 1, width + 2, height + 2}, cv::Scalar(60, 60, 60), 1);
    for (int tick = -2; tick <= 2; ++tick) {
      const double value_m = 0.5 * tick * range_m;
      const std::string text = (tick == 0 ? "0" : absl::StrFormat("%+g", value_m)) + (tick == 2 ? " m" : "");
      const cv::Size size = cv::getTextSize(text, kFont, scale, 1, nullptr);
      const int x = left + (tick + 2) * width / 4;
      DrawText(canvas, text, {x - size.width / 2, top + height + static_cast<int>(34 * scale)}, scale);
    }
  });
}

}  // namespace tessera
