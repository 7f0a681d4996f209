// Whether a piece of surface encloses a volume although it has holes, and on which side of it a place is: by
// the solid angle that the piece takes as seen from there (its winding number). A scan is seldom without
// holes, and a probe that got in through one must not be held by the wall's back when it comes out.
#pragma once

#include <Eigen/Core>
#include <span>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// A small part of an oriented surface, as seen from afar. mm, or any other unit; `area` along the normal.
struct SurfacePart {
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  Eigen::Vector3f area = Eigen::Vector3f::Zero();
};

/// Of all directions from `at` the share in which the parts are seen from where their normals point away:
/// about 1 within a closed surface with normals outwards, 0 outside of it, -1 and 0 with normals inwards.
/// Parts nearer than half their width count less, so a place nearer than that to the surface is told about
/// correctly only to a half. O(parts).
[[nodiscard]] double share_around(std::span<const SurfacePart> parts, const Vec3& at) noexcept;

/// 1 where the parts enclose a volume but for holes and their normals point outwards, -1 where they point
/// inwards; 0 where they are an open surface, or too thin or small to tell. The same for any number of
/// threads. O(parts).
[[nodiscard]] float outer_side(std::span<const SurfacePart> parts, int threads = 1);

}  // namespace palpate::geometry
