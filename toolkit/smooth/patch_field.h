// The signed distance to the points' surface at any place: single-valued, positive outside. The points next
// to the place tell which patches count there, the patches how far off they are, and what does not agree with
// most of them has no say: so a face keeps its distance up to its edge.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/cover.h"
#include "toolkit/smooth/point_patches.h"

namespace palpate::render {

/// Distance along the normal, mm, and the unit normal.
struct FieldValue {
  double distance_mm = 0.0;
  Vec3 normal = Vec3::UnitZ();
};

/// Scratch that is used again from cube to cube. Belongs to one thread; what it answers depends on the
/// question alone.
class PatchField {
 public:
  /// Keeps references.
  PatchField(const SmoothPoints& points, std::span<const Patch> patches, std::span<const PointPatches> of)
      : points_(points), patches_(patches), of_(of), slot_(patches.size(), kNone) {}

  /// Places are asked about within `reach_mm` of `middle` until the next call. False where no point is near
  /// enough to tell, within `most_mm`. O(points near).
  [[nodiscard]] bool begin(const Vec3& middle, double reach_mm, double most_mm);
  /// At `middle` + `at`. O(points near).
  [[nodiscard]] FieldValue at(const Vec3& at);

 private:
  /// Four points at a time.
  static constexpr std::size_t kAtOnce = 4;
  using Lanes = float __attribute__((vector_size(kAtOnce * sizeof(float))));
  struct Places {
    Lanes x, y, z;
  };
  struct Telling {
    std::uint32_t point;
    double weight;
  };
  struct Near {
    std::array<std::uint32_t, kPatchesOfPoint> slot;
    std::array<float, kPatchesOfPoint> share;
  };
  struct Said {
    std::uint32_t slot;
    int face;  ///< 0: of none yet
    double weight, wide, distance;
    Vec3 normal;
  };
  static constexpr std::uint32_t kNone = 0xffffffffu;

  void add(std::uint32_t point);
  [[nodiscard]] FieldValue mean_of_all(double weights) const;
  [[nodiscard]] FieldValue agree(int face);

  const SmoothPoints& points_;
  std::span<const Patch> patches_;
  std::span<const PointPatches> of_;
  Vec3 middle_ = Vec3::Zero();
  double width_ = 1.0;            ///< within which points tell of a place, mm
  std::vector<Places> places_;    ///< of the points near, from the middle, mm
  std::vector<Lanes> sq_;         ///< their squared distances from the place asked about
  std::vector<Near> near_;        ///< point by point
  std::vector<Telling> telling_;  ///< those that tell of the place asked about
  std::vector<std::uint32_t> used_;
  std::vector<std::uint32_t> slot_;    ///< of each patch its place in used_, or kNone
  std::vector<double> weight_, wide_;  ///< beside used_
  std::vector<std::uint8_t> face_;     ///< beside used_: of those that said something
  std::vector<Said> said_;
};

/// The distance of a place to a quadric, at the nearest place of it.
[[nodiscard]] FieldValue distance_to(const Quadric& q, const Vec3& place) noexcept;

}  // namespace palpate::render
