// What a model's surface does to the probe.
#pragma once

namespace palpate::surface {

/// Uniform over a model. Stiffness of the spring between HIP and god object, N/mm.
struct Surface {
  double stiffness_n_per_mm = 0.5;
};

}  // namespace palpate::surface
