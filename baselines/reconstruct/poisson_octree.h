// Poisson reconstruction on an octree; the other one, on a Delaunay refinement, is `poisson`.
#pragma once

#include "baselines/reconstruct/method_functions.h"

namespace palpate::baselines {

MethodFunction poisson_octree;

}  // namespace palpate::baselines
