// Image<T>: a rectangle of values, row after row without gaps.
// Pixel (x, y) = (column, row); (0, 0) is the *centre* of the top-left pixel.
#pragma once

#include "core/error.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

namespace fringecal {

template <class T>
class Image {
 public:
  Image() = default;
  Image(int width, int height, T value = T{})
      : width_(width), height_(height), values_(checked_size(width, height), value) {}

  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t size() const { return values_.size(); }
  bool empty() const { return values_.empty(); }

  T& operator()(int x, int y) { return values_[index(x, y)]; }
  const T& operator()(int x, int y) const { return values_[index(x, y)]; }
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width_ + x; }
  bool contains(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }

  std::span<T> row(int y) { return {values_.data() + index(0, y), static_cast<std::size_t>(width_)}; }
  std::span<const T> row(int y) const { return {values_.data() + index(0, y), static_cast<std::size_t>(width_)}; }
  std::vector<T>& values() { return values_; }
  const std::vector<T>& values() const { return values_; }
  T* data() { return values_.data(); }
  const T* data() const { return values_.data(); }

 private:
  static std::size_t checked_size(int width, int height) {
    require(width >= 0 && height >= 0, "an image has no negative side");
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }

  int width_ = 0, height_ = 0;
  std::vector<T> values_;
};

using Image8 = Image<std::uint8_t>;
using Image16 = Image<std::uint16_t>;

/// A camera frame as it was delivered: 8 bit, or 9 to 16 bit kept in 16.
using GrayImage = std::variant<Image8, Image16>;

inline int width_of(const GrayImage& image) {
  return std::visit([](const auto& i) { return i.width(); }, image);
}
inline int height_of(const GrayImage& image) {
  return std::visit([](const auto& i) { return i.height(); }, image);
}

}  // namespace fringecal
