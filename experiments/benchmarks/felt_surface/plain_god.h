// A god object on stars with nothing but what it cannot do without, so that single rules of a frame can be
// left out: the frame of `cloud` itself has no switches.
#pragma once

#include <memory>

#include "toolkit/render/renderer.h"

namespace palpate::felt {

struct PlainRules {
  bool segment = true;  ///< entered where the HIP's step goes through a triangle; else where the side of the
                        ///< nearest one changed
  bool pseudonormal = true;  ///< the side of an edge or corner by all facets there; else by the one walked on
};

/// One model at rest, felt without friction; closed pieces from outside. No bound on a frame's work.
[[nodiscard]] std::unique_ptr<render::HapticRenderer> make_plain_god(const PlainRules& rules);

/// Forgets its god object after every frame in contact, and looks for it anew along the way from a little in
/// front of where it was to the HIP.
[[nodiscard]] std::unique_ptr<render::HapticRenderer> make_forgetful(
    std::unique_ptr<render::HapticRenderer> renderer);

}  // namespace palpate::felt
