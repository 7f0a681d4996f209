// The patches of one sheet in one cube, parted along the seams that pass through it: one line, or two that
// cross.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/seams.h"

namespace palpate::render {

inline constexpr std::size_t kMostSeamLines = 2, kMostSeamSides = 4;

/// Scratch that is used again from cube to cube. Belongs to one thread.
class CubeSeams {
 public:
  /// `sheet`: its patches, of one face; `middle` of the cube, `half` of its edge. False where no seam is
  /// known to any of them, or those that pass through are not along one line or two. O(patches).
  [[nodiscard]] bool part(std::span<const std::uint32_t> sheet, const std::vector<Patch>& patches,
                          const Seams& seams, const Vec3& middle, double half);
  /// Lines that pass through the cube, 0 to 2.
  [[nodiscard]] std::size_t lines() const noexcept { return lines_; }
  [[nodiscard]] const Seam& line(std::size_t i) const noexcept { return *line_[i]; }
  /// How far a place is beyond a line, mm.
  [[nodiscard]] double past(std::size_t i, const Vec3& at) const {
    return line_[i]->across.dot(at - line_[i]->at);
  }
  /// A place's side: bit i where it is beyond line i.
  [[nodiscard]] std::size_t side_of(const Vec3& at) const {
    std::size_t side = 0;
    for (std::size_t i = 0; i < lines_; ++i)
      if (past(i, at) > 0.0) side |= std::size_t{1} << i;
    return side;
  }
  /// The patches of a side, ascending.
  [[nodiscard]] std::span<const std::uint32_t> patches(std::size_t side) const noexcept {
    return side_[side];
  }

 private:
  [[nodiscard]] bool find_lines(std::span<const std::uint32_t> sheet, const std::vector<Patch>& patches,
                                const Seams& seams, const Vec3& middle, double half);
  /// The line that a seam is along, or lines().
  [[nodiscard]] std::size_t along(const Seam& seam, double spacing) const;

  std::size_t lines_ = 0;
  std::array<const Seam*, kMostSeamLines> line_{};
  std::array<std::vector<std::uint32_t>, kMostSeamSides> side_;
};

}  // namespace palpate::render
