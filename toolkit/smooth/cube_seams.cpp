#include "toolkit/smooth/cube_seams.h"

#include <algorithm>
#include <cmath>

namespace palpate::render {
namespace {

/// Lines that cross do so at 60 degrees and more.
constexpr double kCrossing = 0.5;
/// A line passes through a cube where it comes so much nearer than its walls, as a share of half its edge: as
/// much as its places are uncertain, and as its sides have to agree beside it.
constexpr double kBeside = 0.25;
bool passes(const Seam& seam, const Vec3& middle, double half) {
  return std::abs(seam.across.dot(middle - seam.at)) < half * (seam.across.cwiseAbs().sum() + kBeside);
}

}  // namespace

std::size_t CubeSeams::along(const Seam& seam, double spacing) const {
  for (std::size_t i = 0; i < lines_; ++i)
    if (along_line(*line_[i], seam, spacing)) return i;
  return lines_;
}

/// The first is that next to the middle of the cube, the second one that is not along it.
bool CubeSeams::find_lines(std::span<const std::uint32_t> sheet, const std::vector<Patch>& patches,
                           const Seams& seams, const Vec3& middle, double half) {
  lines_ = 0;
  bool any = false;
  for (std::size_t round = 0; round < kMostSeamLines; ++round) {
    const Seam* next = nullptr;
    double nearest_sq = 0.0;
    for (const std::uint32_t patch : sheet) {
      if (seams.of[patch] == Seams::kNone) continue;
      any = true;
      if (seams.crossed[patch] != 0) continue;
      const Seam& seam = seams.all[seams.of[patch]];
      const double sq = (seam.at - middle).squaredNorm();
      if (!passes(seam, middle, half) || (next != nullptr && !(sq < nearest_sq)) ||
          along(seam, patches[patch].spacing) < lines_)
        continue;
      next = &seam;
      nearest_sq = sq;
    }
    if (next == nullptr) return any;
    line_[lines_++] = next;
  }
  return std::abs(line_[0]->across.dot(line_[1]->across)) < kCrossing;
}

bool CubeSeams::part(std::span<const std::uint32_t> sheet, const std::vector<Patch>& patches,
                     const Seams& seams, const Vec3& middle, double half) {
  if (!find_lines(sheet, patches, seams, middle, half)) return false;
  for (std::vector<std::uint32_t>& of : side_) of.clear();
  for (const std::uint32_t patch : sheet) {
    if (seams.crossed[patch] != 0) continue;
    const Patch& p = patches[patch];
    const std::uint32_t of = seams.of[patch];
    const Seam* const seam = of != Seams::kNone ? &seams.all[of] : nullptr;
    const std::size_t own = seam != nullptr ? along(*seam, p.spacing) : lines_;
    if (seam != nullptr && own == lines_ && passes(*seam, middle, half)) return false;
    // Of a seam it is the line's place that tells on which side of another line its patches are.
    const Vec3& at = seam != nullptr ? seam->at : p.quadric.at;
    const std::size_t side = side_of(at);
    if (seam == nullptr) {
      side_[side].push_back(patch);
    } else if (own == lines_) {
      // Its line is elsewhere: of its sides that which the cube is on.
      side_[side].push_back(seam->across.dot(middle - seam->at) > 0.0 ? seam->beyond : seam->before);
    } else {
      const std::size_t bit = std::size_t{1} << own;
      const bool same = seam->across.dot(line_[own]->across) > 0.0;
      side_[side & ~bit].push_back(same ? seam->before : seam->beyond);
      side_[side | bit].push_back(same ? seam->beyond : seam->before);
    }
  }
  for (std::vector<std::uint32_t>& of : side_) std::sort(of.begin(), of.end());
  return true;
}

}  // namespace palpate::render
