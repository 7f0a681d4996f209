// A finer surface through the same points.
#pragma once

#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// Levels that pay: each costs four times the memory of the last, and halves the error that is left.
inline constexpr int kMostRefined = 3;

/// Every triangle cut into four, `levels` times. The new point of an edge lies where a curve that leaves both
/// ends along their planes passes its middle (a cubic Hermite segment), so that where points lie on a smooth
/// surface it is nearer to that surface by an order than the edge is. Creases stay: an edge between facets
/// that differ by more than a crease's angle is halved straight, and beside a crease each side has normals of
/// its own. The points themselves do not move. A new place has the order() of one of its ends.
///
/// Parallel, the same for any number of threads, O(4^levels n).
[[nodiscard]] StarMesh refined(StarMesh mesh, int levels, int threads);

}  // namespace palpate::stars
