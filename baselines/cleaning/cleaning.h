// Cleaning steps for raw scans, by CGAL: outliers, smooth, thin, upsample, fill-holes.
#pragma once

#include "toolkit/scene/cleaning.h"

namespace palpate::baselines {

/// Adds every step. Lengths are in spacings (the root of the occupied area per point), so that scaling a
/// cloud scales what cleaning does. CGAL runs on one thread: the result does not depend on `threads`.
void register_cleaning(scene::Cleaning& cleaning);

}  // namespace palpate::baselines
