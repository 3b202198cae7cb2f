// A raster of flags as bits, of which 64 are handled at once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace tessera {

// Column x of a row is bit x % 64 of word x / 64. Bits beyond the width may be set.
class BitRaster {
 public:
  static constexpr int kWordBits = 64;

  BitRaster(int width, int height)
      : words_((width + kWordBits - 1) / kWordBits), height_(height), bits_(static_cast<size_t>(words_) * height, 0) {}

  int height() const { return height_; }
  std::span<uint64_t> row(int y) {
    return {bits_.data() + static_cast<size_t>(y) * words_, static_cast<size_t>(words_)};
  }
  std::span<const uint64_t> row(int y) const {
    return {bits_.data() + static_cast<size_t>(y) * words_, static_cast<size_t>(words_)};
  }

  // The columns [x0, x1) of a row, x0 < x1.
  void Set(int y, int x0, int x1) {
    ForWords(x0, x1, [words = row(y)](int w, uint64_t mask) { return words[w] |= mask, false; });
  }
  bool Meets(int y, int x0, int x1) const {
    return ForWords(x0, x1, [words = row(y)](int w, uint64_t mask) { return (words[w] & mask) != 0; });
  }

 private:
  // Calls body(word, mask of its columns) until it returns true; returns whether it did.
  template <class Body>
  static bool ForWords(int x0, int x1, const Body& body) {
    const int first = x0 / kWordBits, last = (x1 - 1) / kWordBits;
    for (int w = first; w <= last; ++w) {
      uint64_t mask = ~uint64_t{0};
      if (w == first) mask &= ~uint64_t{0} << (x0 % kWordBits);
      if (w == last) mask &= ~uint64_t{0} >> (kWordBits - 1 - (x1 - 1) % kWordBits);
      if (body(w, mask)) return true;
    }
    return false;
  }

  int words_, height_;
  std::vector<uint64_t> bits_;
};

// Sets every bit that is at most `distance` columns from a set one.
inline void Widen(std::span<uint64_t> row, int distance) {
  const auto words = static_cast<int>(row.size());
  for (int done = 0; done < distance;) {
    // Bits that are set reach `done` further already, so this may double.
    const int shift = std::min({done + 1, distance - done, BitRaster::kWordBits - 1});
    uint64_t below = 0;  // the word before, as it was
    for (int w = 0; w < words; ++w) {
      const uint64_t word = row[w], above = w + 1 < words ? row[w + 1] : 0;
      row[w] |= word << shift | below >> (BitRaster::kWordBits - shift) | word >> shift |
                above << (BitRaster::kWordBits - shift);
      below = word;
    }
    done += shift;
  }
}

}  // namespace tessera
