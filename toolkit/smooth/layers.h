// A sheet with creases in a cube: a layer for each of its faces, which goes on smoothly beyond the crease, so
// that the crease stays sharp. The sheet's distance is the least over its bodies of the greatest of each.
#pragma once

#include "toolkit/smooth/newton_step.h"
#include "toolkit/smooth/spline.h"

namespace palpate::render {

// Of the sheet whose first brick is given. Thread-safe; each evaluates all its layers, kMostLayers at most.

[[nodiscard]] float layers_value(const Brick* first, const BrickPlace& at) noexcept;
/// What the layer tells that counts there.
[[nodiscard]] Jet layers_jet(const Brick* first, const BrickPlace& at) noexcept;
/// Its value is the sheet's, the rest of the layer next to it that faces most along `normal`: beside a crease
/// that is not certain to be the one that counts.
[[nodiscard]] Jet layers_jet_along(const Brick* first, const BrickPlace& at, const Vec3& normal) noexcept;

/// The mean normal, of growing distance, of the layers that are within `reach` voxels of counting there.
[[nodiscard]] Vec3 layers_normal(const Brick* first, const BrickPlace& at, float reach) noexcept;

/// One step, d at most, towards the place next to d that is free on `side`: on the layer that counts, or,
/// where layers meet in a crease that is hollow from that side, on several.
[[nodiscard]] NewtonStep layers_step(const Brick* first, const BrickPlace& at, const Vec3& d, double side,
                                     double longest, bool exact = true) noexcept;

}  // namespace palpate::render
