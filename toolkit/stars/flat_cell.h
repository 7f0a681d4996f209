// The Voronoi cell of one point among neighbours laid out in a plane around it: its corners are the triangles
// of the point's Delaunay star.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace palpate::stars {

/// A neighbour laid out flat, relative to the point.
struct FlatPoint {
  double u = 0.0, v = 0.0;
  double half_square = 0.0;  ///< half of its power: (|q|^2 + the point's weight - its own) / 2
};

/// Corners that a cell may have. Random points have six on average, and more than 24 once in far more stars
/// than anybody has points; what would be more is left out.
inline constexpr std::size_t kMaxCorners = 24;
/// In place of a neighbour: the border that the cell began with.
inline constexpr std::uint32_t kOpenSide = 0xFFFFFFFFu;

/// A convex polygon around the origin, counter-clockwise. Allocates nothing.
class FlatCell {
 public:
  struct Corner {
    double u, v;
    std::uint32_t side;  ///< whose bisector the edge from here to the next corner lies on
  };

  /// The square of half edge `reach`.
  void start(double reach) noexcept {
    size_ = 4;
    corner_[0] = {reach, reach, kOpenSide};
    corner_[1] = {-reach, reach, kOpenSide};
    corner_[2] = {-reach, -reach, kOpenSide};
    corner_[3] = {reach, -reach, kOpenSide};
  }
  /// Takes away what is nearer to `q` than to the origin.
  void cut(const FlatPoint& q, std::uint32_t side) noexcept;

  [[nodiscard]] bool has_side(std::uint32_t side) const noexcept {
    for (std::size_t i = 0; i < size_; ++i)
      if (corner_[i].side == side) return true;
    return false;
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] const Corner& operator[](std::size_t i) const noexcept { return corner_[i]; }
  /// Squared distance of the farthest corner.
  [[nodiscard]] double reach_sq() const noexcept {
    double most = 0.0;
    for (std::size_t i = 0; i < size_; ++i) {
      const double d = corner_[i].u * corner_[i].u + corner_[i].v * corner_[i].v;
      most = d > most ? d : most;
    }
    return most;
  }

 private:
  std::array<Corner, kMaxCorners> corner_;
  std::size_t size_ = 0;
};

inline void FlatCell::cut(const FlatPoint& q, std::uint32_t side) noexcept {
  std::array<double, kMaxCorners> over;
  bool any = false;
  for (std::size_t i = 0; i < size_; ++i) {
    over[i] = corner_[i].u * q.u + corner_[i].v * q.v - q.half_square;
    any = any || over[i] > 0.0;
  }
  if (!any) return;
  // One run of corners goes; a corner where the polygon is cut on each side of it comes.
  std::size_t first = 0;  // kept, and the next one is not
  while (first < size_ && !(over[first] <= 0.0 && over[first + 1 == size_ ? 0 : first + 1] > 0.0)) ++first;
  if (first == size_) {  // nothing is kept: the point is doubled
    size_ = 0;
    return;
  }
  std::size_t last = first + 1 == size_ ? 0 : first + 1;  // gone, and the next one is not
  std::size_t gone = 1;
  for (std::size_t next = last + 1 == size_ ? 0 : last + 1; over[next] > 0.0;
       next = last + 1 == size_ ? 0 : last + 1) {
    last = next;
    ++gone;
  }
  const std::size_t next = last + 1 == size_ ? 0 : last + 1;
  if (size_ - gone + 2 > kMaxCorners) return;
  const auto between = [&](std::size_t a, std::size_t b, std::uint32_t of) {
    const double t = over[a] / (over[a] - over[b]);
    return Corner{corner_[a].u + t * (corner_[b].u - corner_[a].u),
                  corner_[a].v + t * (corner_[b].v - corner_[a].v), of};
  };
  const std::size_t second = first + 1 == size_ ? 0 : first + 1;
  const Corner in = between(first, second, side);
  const Corner out = between(next, last, corner_[last].side);
  std::array<Corner, kMaxCorners> kept;
  std::size_t count = 0;
  kept[count++] = in;
  kept[count++] = out;
  for (std::size_t i = next, left = size_ - gone; left > 0; --left, i = i + 1 == size_ ? 0 : i + 1)
    kept[count++] = corner_[i];
  size_ = count;
  for (std::size_t i = 0; i < count; ++i) corner_[i] = kept[i];
}

}  // namespace palpate::stars
