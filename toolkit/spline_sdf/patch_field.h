// The signed distance field of the patches: single-valued, positive outside. Points near a place select
// patches, patches give distances, and those that disagree with the majority are ignored, so a face keeps its
// distance up to its edge.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/spline_sdf/fit_patches.h"
#include "toolkit/spline_sdf/patch_lanes.h"

namespace palpate::spline_sdf {

/// Distances along the normals, mm, and unit normals of eight places.
struct alignas(kLanesAlignment) FieldLanes {
  NodeLanes distance_mm{};
  NodePlaces normal;
  [[nodiscard]] double distance_at(std::size_t lane) const noexcept {
    return static_cast<double>(distance_mm[lane]);
  }
  [[nodiscard]] Vec3 normal_at(std::size_t lane) const noexcept {
    return {static_cast<double>(normal.x[lane]), static_cast<double>(normal.y[lane]),
            static_cast<double>(normal.z[lane])};
  }
};

/// Scratch memory, reused between cubes. Belongs to one thread; results depend on the query only.
class PatchDistanceField {
 public:
  /// Keeps references.
  PatchDistanceField(const MortonPoints& points, std::span<const QuadricPatch> patches,
                     std::span<const PointPatches> of)
      : points_(points), patches_(patches), of_(of), slot_(patches.size(), kNone) {}

  /// Prepares queries within `reach_mm` of `middle`. False if no point is near enough within `most_mm`.
  /// O(points near).
  [[nodiscard]] bool begin(const Vec3& middle, double reach_mm, double most_mm);
  /// The field at `middle` + `at_mm`. O(points near).
  void evaluate(const NodePlaces& at_mm, FieldLanes& out);

  /// Input and output of a query; lengths in units of `width_mm`.
  struct Near {
    struct Point {
      float x, y, z;
      std::array<std::uint32_t, kPatchesOfPoint> slot;
      std::array<float, kPatchesOfPoint> share;
    };
    /// A patch at eight places; `face`: of which face it is, 0 for none yet.
    struct alignas(kLanesAlignment) Patch {
      NodeLanes weight{}, wide{}, distance{};
      NodePlaces normal;
      NodeBits face{};
    };
    struct alignas(kLanesAlignment) Contribution {
      NodeLanes weight;
      std::uint32_t point;
    };
    /// Of a point to eight places.
    struct alignas(kLanesAlignment) SqDistance {
      NodeLanes sq;
    };
    double width_mm = 1.0;  ///< range in which points contribute
    std::vector<Point> points;
    std::vector<QuadricLanes> quadrics;
    std::vector<SqDistance> distances;  ///< per point
    std::vector<Patch> patches;         ///< parallel to quadrics
    std::vector<std::uint32_t> heard;   ///< patches that contribute to a queried place
    std::size_t contributors = 0;
    std::vector<Contribution> contributions;  ///< the first `contributors`: points that contribute
  };

 private:
  static constexpr std::uint32_t kNone = 0xffffffffu;

  void add(std::uint32_t point);

  const MortonPoints& points_;
  std::span<const QuadricPatch> patches_;
  std::span<const PointPatches> of_;
  Vec3 middle_ = Vec3::Zero();
  Near near_;
  std::vector<std::uint32_t> used_;  ///< patches of the near points
  std::vector<std::uint32_t> slot_;  ///< each patch's index in used_, or kNone
};

}  // namespace palpate::spline_sdf
